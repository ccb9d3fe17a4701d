"""Prove what the built-in robot files say of their capsules, against the meshes.

    python benchmarks/capsule_credits.py [ur3 ur5 ur10]

A robot file may say that the capsules of two links may overlap by so much before the links
touch (`overlap`), and that two links cannot meet (`apart`); capsules that overlap in every pose
are left out of the judgement by dynid itself. For every two links that this concerns, the whole
space of the joints between them is searched by branch and bound: a box of joint positions is
settled when the judge refuses all of it, or the meshes (coal) stay apart in all of it, since a
body moves no faster than its reach. A pose where the meshes touch and the judge is content is a
counter-example. Prints one line a pair, with the least distance of the meshes wherever the
judge is content; exits 1 if there is a counter-example or a box that could not be settled.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
from collision_oracle import DATA
from scipy.spatial import ConvexHull

from dynid.constraints import Bodies, safe_constraints
from dynid.robot import RobotModel, load_robot

FIRST = 16
"""Boxes a joint to begin with."""
GRID = 180
"""Positions of a joint when looking how far things get."""
MOST = 1_500_000
"""Mesh distances for one pair of links before giving up."""


class Meshes:
    """The meshes of each link of a UR arm."""

    def __init__(self, name: str) -> None:
        urdf = str(DATA / f"ur_description/urdf/{name}_robot.urdf")
        self.model = pin.buildModelFromUrdf(urdf)
        self.shapes = pin.buildGeomFromUrdf(
            self.model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(DATA.parent.parent)]
        )
        self.data = self.model.createData()

    def of(self, link: int) -> list[pin.GeometryObject]:
        """The shapes of a link."""
        return [item for item in self.shapes.geometryObjects if item.parentJoint == link]

    def distance(self, q: np.ndarray, inner: int, outer: int) -> float:
        """Between the meshes of two links, not above 0 where they touch [m]."""
        pin.forwardKinematics(self.model, self.data, q)
        least = np.inf
        for a in self.of(inner):
            for b in self.of(outer):
                placed = (self.data.oMi[x.parentJoint] * x.placement for x in (a, b))
                at = [coal.Transform3s(x.rotation, x.translation) for x in placed]
                result = coal.DistanceResult()
                request = coal.DistanceRequest()
                far = coal.distance(a.geometry, at[0], b.geometry, at[1], request, result)
                least = min(least, far)
        return least

    def points(self, link: int) -> np.ndarray:
        """(P, 3) corners of a link's shapes in its joint frame [m]."""
        found = []
        for item in self.of(link):
            shape = item.geometry
            if hasattr(shape, "halfSide"):
                signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
                corners = signs * shape.halfSide
            else:
                corners = np.asarray(shape.vertices())
            found.append(corners @ item.placement.rotation.T + item.placement.translation)
        return np.concatenate(found)

    def reach(self, points: np.ndarray, inner: int, outer: int) -> np.ndarray:
        """(outer - inner) how far points of the outer link get from the axes between [m].

        Tried in positions of the joints behind each axis on a grid, and 2 % more.
        """
        points = points[ConvexHull(points, qhull_options="QJ").vertices]
        turns = np.linspace(-np.pi, np.pi, GRID, endpoint=False)
        found = []
        for k in range(outer, inner, -1):
            q = np.zeros(self.model.nq)
            pin.forwardKinematics(self.model, self.data, q)
            before = np.array(self.data.oMi[k].rotation)
            q[k - 1] = 1.0
            pin.forwardKinematics(self.model, self.data, q)
            axis = pin.log3(before.T @ np.array(self.data.oMi[k].rotation))
            along = points @ axis
            square = np.maximum(np.sum(points**2, axis=1) - along**2, 0.0)
            found.append(1.02 * float(np.sqrt(square.max())))
            # What matters of the points once this joint turns: a ring for each.
            keep = np.unique(np.round(np.column_stack([along, np.sqrt(square)]), 4), axis=0)
            keep = keep[ConvexHull(keep, qhull_options="QJ").vertices]
            side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            side /= np.linalg.norm(side)
            ring = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * np.cross(axis, side)
            turned = keep[:, :1, None] * axis + keep[:, 1:, None] * ring[None]
            place = self.model.jointPlacements[k]
            points = turned.reshape(-1, 3) @ place.rotation.T + place.translation
        return np.array(found[::-1])


class Judge:
    """What dynid says of two links."""

    def __init__(self, robot: RobotModel, inner: int, outer: int) -> None:
        settings = safe_constraints(robot)
        around = settings.surroundings
        if around is None:
            sys.exit(f"{robot.name} has no capsules")
        every = around.bodies
        self.clearance = settings.settings.self_clearance
        first, second = (np.flatnonzero(every.link == link) for link in (inner, outer))
        whole = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
        mine = (every.link[every.pairs] == [inner, outer]).all(axis=1)
        nothing = np.empty((0, 2), dtype=np.intp)
        self.judged: Bodies = replace(
            every, pairs=every.pairs[mine], overlap=every.overlap[mine].copy(), meetings=nothing
        )
        self.whole: Bodies = replace(
            every, pairs=whole, overlap=np.zeros(len(whole)), meetings=nothing
        )
        self.left_out = len(whole) - int(mine.sum())
        self.credit = float(self.judged.overlap.max(initial=0.0))
        frame = np.linalg.inv(robot.parameter_frames["urdf"][outer - 1])
        ends = every.ends[second].reshape(-1, 3) @ frame[:3, :3].T + frame[:3, 3]
        self.ends = np.concatenate([ends, ends + 1e-6])
        """Of the outer link's capsules, in ROS's frame of it [m]."""

    def room(self, q: np.ndarray) -> np.ndarray:
        """(N) what is left of the clearance by the judge; infinite where nothing is judged."""
        own, _ = self.judged.distances(q)
        return own.min(axis=1, initial=np.inf) - self.clearance

    def capsules(self, q: np.ndarray) -> np.ndarray:
        """(N) distance of the capsules, none left out."""
        return self.whole.distances(q)[0].min(axis=1)


def prove(meshes: Meshes, judge: Judge, inner: int, outer: int) -> tuple[str, float, int]:
    """Search all positions of the joints between two links.

    Returns:
        `proven`, `open` or `touching`, the least mesh distance seen where the judge is content
        [m], and how often the meshes were asked.
    """
    count, joints = outer - inner, meshes.model.nq
    reach = meshes.reach(meshes.points(outer), inner, outer)
    ours = meshes.reach(judge.ends, inner, outer)
    half = np.full(count, np.pi / FIRST)
    ticks = -np.pi + half[0] * (2 * np.arange(FIRST) + 1)
    boxes = np.stack(np.meshgrid(*[ticks] * count, indexing="ij"), axis=-1).reshape(-1, count)
    least, asked = np.inf, 0
    while len(boxes):
        if asked > MOST:
            return "open", least, asked
        q = np.zeros((len(boxes), joints))
        q[:, inner:outer] = boxes
        room, far = judge.room(q), judge.capsules(q)
        moves = float(ours @ half)
        unsettled = np.flatnonzero((room + moves >= 0) & (far - moves <= 0))
        left = []
        for k in unsettled:
            distance = meshes.distance(q[k], inner, outer)
            asked += 1
            if room[k] >= 0:
                least = min(least, distance)
                if distance <= 0:
                    print(f"      touching at {q[k, inner:outer]}, room {1e3 * room[k]:.2f} mm")
                    return "touching", least, asked
            if distance - float(reach @ half) <= 0:
                left.append(k)
        widest = int(np.argmax(np.maximum(reach, ours) * half))
        half[widest] /= 2
        step = np.zeros(count)
        step[widest] = half[widest]
        boxes = np.concatenate([boxes[left] - step, boxes[left] + step])
    return "proven", least, asked


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=["ur3", "ur5", "ur10"])
    parser.add_argument("--links", nargs=2, type=int, help="these two alone")
    given = parser.parse_args()
    failed = False
    for name in given.robots:
        robot, meshes = load_robot(name), Meshes(name)
        for inner in range(robot.joints - 1):
            for outer in range(inner + 2, robot.joints + 1):
                if given.links and given.links != [inner, outer]:
                    continue
                judge = Judge(robot, inner, outer)
                if not judge.left_out and not judge.credit:
                    continue
                verdict, least, asked = prove(meshes, judge, inner, outer)
                failed |= verdict != "proven"
                print(
                    f"{name:5s} links {inner} and {outer}: {judge.left_out:4d} pairs of capsules"
                    f" left out, credit {1e3 * judge.credit:5.1f} mm: {verdict}, the meshes come"
                    f" as near as {1e3 * least:.2f} mm ({asked} poses asked)",
                    flush=True,
                )
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
