"""The rigid body in numbers: quaternions, means of inertia, exact motions, the paper's problems.

In: quaternions, momenta and inertia as arrays.
Out: attitudes, velocities, γ; exact motions with 30 digits.
Open first: ``quaternion``.

    quaternion     unit quaternions and the state (q, p)
    euler_angles   Euler angles in any sequence of axes
    gamma_rules    γ_m, γ_h and the others (47), (48), (50)
    exact          regular precession and the free body, exactly
    problems       the problems of section 5, as ``gyrospark.problems``
"""
