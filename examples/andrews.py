"""Andrews' squeezing mechanism (IVP test set), defined by its Lagrangian."""

import sympy as sp

import gyrospark as gs

q = be, th, ga, ph, de, om, ep = sp.symbols("beta theta gamma phi delta omega epsilon", real=True)
v = sp.symbols("beta_t theta_t gamma_t phi_t delta_t omega_t epsilon_t", real=True)
text = "m1:8 I1:8 xa ya xb yb xc yc c0 l0 mom d da e ea rr ra ss sa sb sc sd ta tb u ua ub zf zt fa"
numbers = (.04325, .00365, .02373, .00706, .0705, .00706, .05498, 2.194e-6, 4.41e-7, 5.255e-6,
           5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5, -.06934, -.00227, -.03635, .03273, .014, .072,
           4530, .07785, .033, .028, .0115, .02, .01421, .007, .00092, .035, .01874, .01043, .018,
           .02, .02308, .00916, .04, .01228, .00449, .02, .04, .01421)
(m1, m2, m3, m4, m5, m6, m7, I1, I2, I3, I4, I5, I6, I7, xa, ya, xb, yb, xc, yc, c0, l0, mom,
 d, da, e, ea, rr, ra, ss, sa, sb, sc, sd, ta, tb, u, ua, ub, zf, zt, fa
 ) = parameters = sp.symbols(text, real=True)
values = dict(zip(map(str, parameters), numbers, strict=True))
sin, cos, b, t, f, z = sp.sin, sp.cos, v[0], v[1], e - ea, zf - fa
T = (m1*ra**2 + m2*(rr**2 - 2*da*rr*cos(th) + da**2) + I1 + I2)*b**2/2 \
    + (m2*(da**2 - da*rr*cos(th)) + I2)*b*t + (m2*da**2 + I2)*t**2/2 \
    + (m3*(sa**2 + sb**2) + I3)*v[2]**2/2 + (m4*f**2 + I4)*v[3]**2/2 \
    + (m4*(f**2 + zt*f*sin(ph)) + I4)*v[3]*v[4] + (m6*z**2 + I6)*v[5]**2/2 \
    + (m4*(zt**2 + 2*zt*f*sin(ph) + f**2) + m5*(ta**2 + tb**2) + I4 + I5)*v[4]**2/2 \
    + (m6*(z**2 - u*z*sin(om)) + I6)*v[5]*v[6] \
    + (m6*(z**2 - 2*u*z*sin(om) + u**2) + m7*(ua**2 + ub**2) + I6 + I7)*v[6]**2/2
spring = sp.sqrt((sd*cos(ga) + sc*sin(ga) + xb - xc)**2 + (sd*sin(ga) - sc*cos(ga) + yb - yc)**2)
x, y = rr*cos(be) - d*cos(be + th), rr*sin(be) - d*sin(be + th)
g = [x - ss*sin(ga) - xb, y + ss*cos(ga) - yb,
     x - e*sin(ph + de) - zt*cos(de) - xa, y + e*cos(ph + de) - zt*sin(de) - ya,
     x - zf*cos(om + ep) - u*sin(ep) - xa, y - zf*sin(om + ep) + u*cos(ep) - ya]
system = gs.System.from_lagrangian(T - c0*(spring - l0)**2/2 + mom*be, q, v, parameters, g,
                                   name="andrews")
start = [-.0617138900142764496, 0, .45527981916307038, .222668390165885885, .48736497954384254,
         -.222668390165885885, 1.23054744454982119]

if __name__ == "__main__":
    step = gs.stepper("G-L", 4, system=system)
    run = step.integrate(start, [0]*7, dt=1e-4, steps=300, parameters=values)
    for name, angle, rate in zip(run.coordinates, run.q[-1], run.velocities[-1], strict=True):
        print(f"{name:8} {angle:20.15f} {rate:20.12f}")
