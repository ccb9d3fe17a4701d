"""Small URDF texts to read and to damage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dynid.robot import RobotModel, robot_from_urdf

LINK = (
    '<link name="{name}"><visual><geometry><mesh filename="package://x/y.dae"/></geometry></visual>'
    '<inertial><origin xyz="0.1 0 0.2" rpy="0 0.3 0"/><mass value="{mass}"/>'
    '<inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.02" iyz="0" izz="0.015"/></inertial></link>'
)
ARM = f"""<?xml version="1.0" ?>
<!-- made by xacro -->
<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="world"/>
  <joint name="fix" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0 0 0.1" rpy="0 0 0.4"/><axis xyz="0 0 0"/></joint>
  {LINK.format(name="base", mass=5)}
  <joint name="j1" type="continuous"><parent link="base"/><child link="l1"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0" effort="0" velocity="2.0"/></joint>
  {LINK.format(name="l1", mass=4)}
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/>
    <origin xyz="0.1 0 0.2" rpy="1.57079632679 0 0"/><axis xyz="0 -2 0"/>
    <limit lower="-2" upper="1.5" effort="80" velocity="3"/>
    <dynamics damping="1.0" friction="2"/></joint>
  {LINK.format(name="l2", mass=3)}
  <joint name="cover_fix" type="fixed"><parent link="l2"/><child link="cover"/>
    <origin xyz="0 0.2 0" rpy="0.1 0.2 0.3"/></joint>
  {LINK.format(name="cover", mass=0.7)}
  <joint name="j3" type="prismatic"><parent link="cover"/><child link="l3"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0.6 0.8"/>
    <limit lower="0" upper="0.5" effort="100" velocity="1"/></joint>
  {LINK.format(name="l3", mass=2)}
  <joint name="hand_fix" type="fixed"><parent link="l3"/><child link="hand"/>
    <origin xyz="0 0 0.1"/></joint>
  {LINK.format(name="hand", mass=0.5)}
  <joint name="finger_1" type="prismatic"><parent link="hand"/><child link="f1"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/></joint>
  {LINK.format(name="f1", mass=0.1)}
  <joint name="finger_2" type="prismatic"><parent link="hand"/><child link="f2"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/>
    <mimic joint="finger_1" multiplier="2" offset="0.01"/></joint>
  {LINK.format(name="f2", mass=0.1)}
  <joint name="tool0_fix" type="fixed"><parent link="hand"/><child link="tool0"/>
    <origin xyz="0 0 0.2" rpy="0 0 1"/></joint>
  <link name="tool0"/>
  <gazebo reference="l1"><material>Gazebo/Blue</material><mu1>0.2</mu1></gazebo>
  <gazebo><plugin name="c" filename="libx.so"><robotNamespace>/</robotNamespace></plugin></gazebo>
  <transmission name="t1"><type>x</type><joint name="j1"><hardwareInterface>e</hardwareInterface>
    </joint><actuator name="m1"><mechanicalReduction>1</mechanicalReduction></actuator>
  </transmission>
  <ros2_control name="s" type="system"><joint name="j1"><command_interface name="position"/></joint>
  </ros2_control>
</robot>
"""


def chain(*joints: str, links: str = "") -> str:
    """A robot with these joint elements; links a, b, c, ... are all there."""
    names = "".join(f'<link name="{name}"/>' for name in "abcdef")
    return f'<robot name="r">{names}{links}{"".join(joints)}</robot>'


def joint(
    name: str, parent: str, child: str, kind: str = "revolute", inside: str = '<axis xyz="0 0 1"/>'
) -> str:
    """One joint element."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{inside}</joint>"
    )


def ur(shoulder: float, elbow: float, upper: float, fore: float, d: list[float]) -> str:
    """A UR arm in the layout of ros-industrial's URDFs: axes z, y, y, y, z, y.

    Args:
        shoulder: Where link 2's frame stands along its axis [m].
        elbow: The same for links 3 and 4.
        upper: Length of the upper arm.
        fore: Length of the forearm.
        d: d1, d4, d5, d6 of the DH table.
    """
    right = "1.57079632679"
    rows = [
        ((0, 0, d[0]), "0 0 0", "0 0 1"),
        ((0, shoulder, 0), f"0 {right} 0", "0 1 0"),
        ((0, elbow - shoulder, upper), "0 0 0", "0 1 0"),
        ((0, 0, fore), f"0 {right} 0", "0 1 0"),
        ((0, d[1] - elbow, 0), "0 0 0", "0 0 1"),
        ((0, 0, d[2]), "0 0 0", "0 1 0"),
    ]
    text = '<robot name="ur"><link name="base_link"/>'
    for k, (xyz, rpy, axis) in enumerate(rows):
        text += f'<link name="l{k + 1}"/>' + joint(
            f"j{k + 1}",
            "base_link" if k == 0 else f"l{k}",
            f"l{k + 1}",
            inside=f'<origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{rpy}"/><axis xyz="{axis}"/>',
        )
    flange = f'<origin xyz="0 {d[3]} 0" rpy="-{right} 0 0"/>'
    text += '<link name="tool0"/>' + joint("flange", "l6", "tool0", "fixed", flange)
    return text + "</robot>"


URS = {
    "ur3": ur(0.1198, 0.0273, 0.24365, 0.21325, [0.1519, 0.11235, 0.08535, 0.0819]),
    "ur5": ur(0.13585, 0.01615, 0.425, 0.39225, [0.089159, 0.10915, 0.09465, 0.0823]),
    "ur10": ur(0.220941, 0.049041, 0.612, 0.5723, [0.1273, 0.163941, 0.1157, 0.0922]),
}


def load_urdf(path: Path, **words: Any) -> RobotModel:
    return robot_from_urdf(path.read_bytes(), where=path.name, file=path, **words)
