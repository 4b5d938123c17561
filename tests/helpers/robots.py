"""Robots that tests run, and the accelerations of a model without its stepper."""

from __future__ import annotations

import numpy as np
import sympy as sp

from gyrospark.generator.symbolic.derivatives import derivative
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.systems.numeric_system import NumericSystem

TINY = 1e-100

#: A bar with meshes, and a hand that is fast to it.
BAR = """<robot name="arm"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><mesh filename="package://shown/meshes/a.stl"/></geometry>
  </visual></link>
<link name="bar"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial>
  <visual><origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/>
    <geometry><mesh filename="meshes/a.stl" scale="0.1 0.1 0.1"/></geometry>
    <material name="red"/></visual>
  <visual><geometry><cylinder radius="0.05" length="1"/></geometry></visual></link>
<link name="hand"><visual><geometry><mesh filename="meshes/b.dae"/></geometry></visual></link>
<joint name="elbow" type="continuous"><parent link="base"/><child link="bar"/>
  <axis xyz="1 0 0"/></joint>
<joint name="wrist" type="fixed"><parent link="bar"/><child link="hand"/>
  <origin xyz="1 0 0"/></joint></robot>
"""

#: Three links in space: a hinge askew, a slide, a continuous joint; one link is fixed to another.
ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper arm">
    <inertial>
      <origin xyz="0.02 -0.01 0.3" rpy="0.1 -0.2 0.3"/>
      <mass value="2.5"/>
      <inertia ixx="0.08" ixy="0.002" ixz="-0.001" iyy="0.07" iyz="0.003" izz="0.02"/>
    </inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual>
  </link>
  <link name="plate">
    <inertial><mass value="0.4"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0"
      izz="0.0015"/></inertial>
  </link>
  <link name="slider">
    <inertial>
      <origin xyz="0 0.03 0.1"/>
      <mass value="1.2"/>
      <inertia ixx="0.01" ixy="0" ixz="0.001" iyy="0.012" iyz="0" izz="0.009"/>
    </inertial>
  </link>
  <link name="wheel">
    <inertial>
      <mass value="0.7"/>
      <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.003"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <origin xyz="0.1 0.2 0.5" rpy="0.3 0.1 -0.4"/>
    <parent link="base"/><child link="upper arm"/><axis xyz="1 2 -1"/>
    <limit lower="-2" upper="2" effort="10" velocity="5"/>
    <dynamics damping="0.3"/>
  </joint>
  <joint name="flange" type="fixed">
    <origin xyz="0.05 0 0.4" rpy="0 0.7 0"/>
    <parent link="upper arm"/><child link="plate"/>
  </joint>
  <joint name="slide-1" type="prismatic">
    <origin xyz="0 0.1 0.2" rpy="-0.5 0 0.2"/>
    <parent link="plate"/><child link="slider"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-1" upper="1" effort="10" velocity="5"/>
  </joint>
  <joint name="wheel" type="continuous">
    <origin xyz="0 0 0.3"/>
    <parent link="slider"/><child link="wheel"/><axis xyz="1 0 0"/>
  </joint>
</robot>
"""


class Motion:
    """q', p' and what follows from them for any quantity, by complex steps and one linear solve.

    W λ = d/dt (g_q H_p + g_t) along (H_p, F − H_q) and the time, and p' = F − H_q − g_qᵀ λ.
    The time is 0.
    """

    def __init__(self, model):
        self.system, self.q, self.p = model.system, model.q0.astype(float), model.p0.astype(float)
        numbers = NumericSystem(self.system, model.parameters)
        self._parameters = numbers._parameters
        self.dq = numbers.H_p(self.q, self.p)
        directions = self.q[:, None] + 1j * TINY * np.eye(len(self.q))
        push = -evaluate([self.system.H], self._at(directions, self.p[:, None]))[0].imag / TINY
        if self.system.forces:
            push = push + evaluate(self.system.forces, self._at(self.q, self.p))
        hidden = self._hidden(numbers._velocity)
        G = numbers.G(self.q)
        forward = self._rate(hidden, push)
        self.multipliers = np.linalg.solve(numbers.W(self.q, self.p, G), forward)
        self.dp = push - G.T @ self.multipliers

    def acceleration(self, quantity):
        """Return the rate of a quantity of the system."""
        return self._rate([self.system.quantities[quantity]], self.dp)[0]

    def value(self, quantity):
        return evaluate([self.system.quantities[quantity]], self._at(self.q, self.p))[0]

    def energy(self):
        return evaluate([self.system.H], self._at(self.q, self.p))[0]

    def _rate(self, expressions, dp):
        displaced = self._at(self.q + 1j * TINY * self.dq, self.p + 1j * TINY * dp)
        if self.system.clock is not None:
            displaced[self.system.clock] = 1j * TINY
        return evaluate(expressions, displaced).imag / TINY

    def _hidden(self, velocity):
        velocity_of = dict(zip(self.system.q, velocity, strict=True))
        if self.system.clock is not None:
            velocity_of[self.system.clock] = sp.S.One
        return [sp.Add(*(derivative(g, x) * v for x, v in velocity_of.items()
                         if x in g.free_symbols))
                for g in self.system.constraints]

    def _at(self, q, p):
        return {**dict(zip(self.system.q, q, strict=True)),
                **dict(zip(self.system.p, p, strict=True)), **self._parameters}
