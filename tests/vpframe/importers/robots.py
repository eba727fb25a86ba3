"""Models of robots."""

import numpy as np
import pinocchio as pin


def pose_of(xyz, yaw=0.0) -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array(xyz, dtype=np.float64))


URDF = """<robot name="arm">
<material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual></link>
<link name="arm">
  <inertial><origin xyz="0.01 0 0" rpy="0 0 0.3"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0.1 0 0"/><geometry><mesh filename="package://arm/meshes/arm.stl" scale="0.001 0.001 0.001"/>
    </geometry><material name="red"/></visual>
</link>
<link name="empty"/>
<link name="tool"><visual><geometry><cylinder radius="0.01" length="0.05"/></geometry></visual></link>
<link name="lost"><visual><geometry><mesh filename="meshes/none.stl"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
  <origin xyz="0 0 0.03" rpy="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="empty"/>
  <origin xyz="0.2 0 0.05"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="spin" type="continuous"><parent link="empty"/><child link="tool"/><axis xyz="0 1 0"/></joint>
<joint name="weld" type="fixed"><parent link="tool"/><child link="lost"/></joint>
</robot>"""
