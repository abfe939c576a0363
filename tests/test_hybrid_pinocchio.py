"""Outside check: the loops closed by Pinocchio with two rigid 6-D constraints."""

import numpy as np
import pytest

from trunnion import hybrid

pin = pytest.importorskip("pinocchio")

ARCSEC = np.pi / 648000
NOMINAL = dict.fromkeys([f"e{i}" for i in range(1, 18)], 0.0) | {
    "e4": 350.0,
    "e8": 600.0,
    "e9": 200.0,
    "e10": 130.0,
    "e11": 200.0,
    "e13": 200.0,
    "e15": 250.0,
}
START = {"u1": -0.3, "v1": -0.36, "u2": -0.6, "v2": 0.0, "phi": 0.0, "w2": 0.3, "u3": -0.3}
START |= {"v3": 0.36, "w1": 0.3, "w3": -0.3}
PASSIVE = [*START]


class PinocchioMachine:
    """The mechanism as an open tree and two rigid constraints; mm and rad."""

    def __init__(self) -> None:
        self.model = pin.Model()
        add = self.model.addJoint
        here = pin.SE3.Identity()
        x, y, z, p = (
            pin.JointModelRX,
            pin.JointModelRY,
            pin.JointModelRZ,
            pin.JointModelPZ,
        )
        self.joint: dict[str, int] = {}
        for leg in "123":
            parent = 0
            chain = [("u", x), ("v", y), *([("phi", z)] if leg == "2" else []), ("L", p)]
            for name, kind in [*chain, ("w", x if leg == "2" else y)]:
                key = name if name == "phi" else name + leg
                parent = self.joint[key] = add(parent, kind(), here, key)
        self.joint["q4"] = add(self.joint["w2"], z(), here, "q4")
        self.joint["q5"] = add(self.joint["q4"], x(), here, "q5")

    def place(self, joint: str, *translation: float) -> None:
        self.model.jointPlacements[self.joint[joint]] = pin.SE3(np.eye(3), np.array(translation))

    def tip(self, e: dict[str, float], active: np.ndarray) -> np.ndarray:
        self.place("u1", -e["e8"], 0, 0)
        self.place("u2", 0, e["e4"], 0)
        self.place("u3", e["e8"], 0, 0)
        for leg in "123":
            self.place("v" + leg, 0, 0, -e["e" + leg])
        platform = np.array([0, -e["e10"], -e["e12"]])
        self.place("q4", *(platform - [0, 0, e["e13"]]))
        self.place("q5", 0, e["e14"], 0)
        seats = [platform + np.array([x, 0, 0]) for x in (-e["e9"], e["e11"])]
        constraints = [
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_6D,
                self.model,
                self.joint[leg],
                pin.SE3.Identity(),
                self.joint["w2"],
                pin.SE3(np.eye(3), seat),
            )
            for leg, seat in zip(("w1", "w3"), seats, strict=True)
        ]
        data = self.model.createData()
        q = pin.neutral(self.model)
        at = {name: self.model.idx_qs[i] for name, i in self.joint.items()}
        commands = active + np.array([e[k] for k in ("e5", "e6", "e7", "e16", "e17")])
        for name, value in zip(("L1", "L2", "L3", "q4", "q5"), commands, strict=True):
            q[at[name]] = -value if name[0] == "L" else value
        for name, value in START.items():
            q[at[name]] = value
        free = [at[name] for name in PASSIVE]
        for _ in range(20):
            pin.forwardKinematics(self.model, data, q)
            pin.computeJointJacobians(self.model, data, q)
            errors, rows = [], []
            for constraint in constraints:
                store = constraint.createData()
                constraint.calc(self.model, data, store)  # or the Jacobian is stale
                one = data.oMi[constraint.joint1_id] * constraint.joint1_placement
                two = data.oMi[constraint.joint2_id] * constraint.joint2_placement
                errors.append(pin.log6(one.actInv(two)).vector)
                rows.append(pin.getConstraintJacobian(self.model, data, constraint, store)[:, free])
            step = np.linalg.lstsq(np.vstack(rows), np.concatenate(errors), rcond=1e-10)[0]
            q[free] += step
            if np.abs(step).max() < 1e-13:
                break
        else:
            raise AssertionError("Pinocchio did not close the loops")
        pin.forwardKinematics(self.model, data, q)
        tool: np.ndarray = data.oMi[self.joint["q5"]].act(np.array([0, 0, -e["e15"]]))
        return tool


def random_case(rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
    """Active joints (mm, rad) and the 17 errors (mm, rad)."""
    legs = np.array([1100.0, 1130.0, 1100.0]) + rng.uniform(-70, 70, 3)
    active = np.array([*legs, rng.uniform(-2, 2), rng.uniform(-0.6, 0.6)])
    sizes = {f"e{i}": rng.uniform(-2, 2) for i in range(1, 16)}
    sizes |= {f"e{i}": rng.uniform(-2e-3, 2e-3) for i in (16, 17)}
    return active, sizes


def face(errors: dict[str, float]) -> dict[str, float]:
    scale = {"e16": ARCSEC, "e17": ARCSEC}
    return {name: value / scale.get(name, 1e-3) for name, value in errors.items()}


def test_tip_and_sensitivities_at_thirty_random_poses_with_errors() -> None:
    machine = PinocchioMachine()
    rng = np.random.default_rng(20)
    worst_tip = worst_rate = 0.0
    for _ in range(30):
        active, errors = random_case(rng)
        joints = np.r_[active[:3], np.degrees(active[3:])]
        ours = hybrid.Mechanism(errors=face(errors)).sensitivity(joints)
        real = {name: NOMINAL[name] + value for name, value in errors.items()}
        off = np.abs(machine.tip(real, active) - ours.forward.tip_mm[0]).max()
        worst_tip = max(worst_tip, off)
        for k, name in enumerate(errors):
            # Five points over a wide step: truncation and rounding both below 1e-10.
            h = 0.5 if k < 15 else 5e-4
            around = [
                machine.tip(real | {name: real[name] + m * h}, active) for m in (-2, -1, 1, 2)
            ]
            rate = (around[0] - 8 * around[1] + 8 * around[2] - around[3]) / (12 * h)
            mine = ours.tip[0, :, k] * (1.0 if k < 15 else 1e-3 / ARCSEC)
            scale = max(1.0, float(np.linalg.norm(rate)))
            worst_rate = max(worst_rate, float(np.abs(rate - mine).max()) / scale)
    assert worst_tip < 1e-9
    assert worst_rate < 1e-8
