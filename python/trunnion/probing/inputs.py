"""What the set-up states of the probe, the artefact and the machine's steps, as inputs of touches.

Each is how the readings change with something that is known only within its standard uncertainty:
the inputs of type B of an uncertainty budget (JCGM 100:2008, 4.3).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion._core import Moves
from trunnion.base.units import Floats, unit_of
from trunnion.data.touches import Touches
from trunnion.machine.budget import Input
from trunnion.machine.stated import Stated
from trunnion.probing.model import TouchModel, catalogue, positions_of
from trunnion.setup import Setup

STEP_ARCSEC = 10.0
HOUR_S = 3600.0
"""Of a rotary axis, over which its effect on the readings is differenced."""
LENGTH = "length of the probe"
DIMENSIONS = (
    *("artefact_length", "artefact_width", "artefact_height"),
    *("artefact_diameter", "artefact_spacing"),
)


def stated_of(setup: Setup) -> dict[str, Stated]:
    """Effects of one parameter that the set-up states to be nothing within an uncertainty."""
    artefact, probe = setup.artefact, setup.probe
    expansion = artefact.expansion_ppm_k * artefact.temperature_std_k
    sizes = (k.replace("_", " ") for k in DIMENSIONS)
    stated = {
        "probe_radius": ("calibration of the probe's ball", probe.calibration_um),
        **{
            k: (f"calibration of the {name}", artefact.calibration_um)
            for k, name in zip(DIMENSIONS, sizes, strict=True)
        },
        "artefact_squareness": (
            "calibration of the artefact's squareness",
            artefact.calibration_arcsec,
        ),
        "artefact_expansion": ("temperature of the artefact", expansion),
    }
    given = {k: Stated(*one) for k, one in stated.items() if one[1] > 0}
    known = {info.id for info in catalogue(setup)} if given else set()
    return {k: one for k, one in given.items() if k in known}


def certificate(model: TouchModel) -> dict[str, Stated]:
    """What the set-up states of parameters that are fitted, by parameter."""
    stated = stated_of(model.setup)
    ids = {name: name.split(".", maxsplit=1)[0] for name in model.names}
    return {name: stated[id_] for name, id_ in ids.items() if id_ in stated}


def inputs_of(model: TouchModel, moves: Moves, data: Touches, values: Floats) -> tuple[Input, ...]:
    """List what the set-up states an uncertainty of, with its influence on touches.

    ``model``, ``values``: touches with the effects that are fitted, and their parameters (p,);
    what is fitted is no input. ``data``, ``moves``: The touches, and as the model knows them.
    """
    stated = stated_of(model.setup)
    others = {k: one for k, one in stated.items() if k not in model.effect_ids}
    return (
        *_known_to(model, moves, others),
        *_ball(OnMachine(model, data, values)),
        *_rotary_steps(model, moves, data.rotary_deg, values),
    )


def _ball(machine: "OnMachine") -> Iterator[Input]:
    """Where the ball stands in the spindle: touches are where it is, not where it is taken to be.

    Of tables only: a head turns it.
    """
    probe = machine.model.setup.probe
    beside = {"x": probe.offset_std_um, "y": probe.offset_std_um}
    places = (("ball beside the spindle axis", beside), (LENGTH, {"z": probe.length_std_um}))
    for name, axes in places:
        (std,) = set(axes.values())
        if std > 0:
            columns = np.stack([machine.moved(letter) for letter in axes], axis=1)
            yield Input(name, std, "µm", columns)


def _known_to(fitted: TouchModel, moves: Moves, stated: Mapping[str, Stated]) -> Iterator[Input]:
    """Effects that are known to be nothing within a standard uncertainty: id → name, std."""
    if not stated:
        return
    model = TouchModel(fitted.setup, list(stated), chain=fitted.chain)
    columns = model.core.linearise(moves, model.values())[1]
    for at, name in enumerate(model.names):
        if (id_ := name.split(".", maxsplit=1)[0]) in stated:
            yield Input(*stated[id_], unit_of(name), columns[:, [at]])


def turning(model: TouchModel, moves: Moves, values: Floats) -> dict[str, Floats]:
    """Change of each reading, (n,), as a rotary axis stands further by 1 arcsec, by its letter."""
    out = {}
    for letter in sorted(model.chain.letters):
        axis, sense = model.chain.letters.index(letter), model.chain.sense_of(letter)
        ahead, behind = (
            model.core.residuals(moves.turned(axis, sense * step / 3600.0), values)
            for step in (STEP_ARCSEC, -STEP_ARCSEC)
        )
        out[letter.lower()] = np.asarray(behind - ahead) / (2 * STEP_ARCSEC)
    return out


@dataclass(frozen=True, eq=False)
class OnMachine:
    """Touches on a machine, for a user's effect that asks how they change.

    ``values``: the model's parameters.
    """

    model: TouchModel
    data: Touches
    values: Floats

    def turning(self) -> dict[str, Floats]:
        """As a rotary axis stands further by 1 arcsec, by its letter."""
        return turning(self.model, self.model.moves(self.data), self.values)

    def moved(self, letter: str) -> Floats:
        """As the tool stands further along a linear axis by 1 µm, (n,)."""
        drift = TouchModel(self.model.setup, [f"drift_{letter}"], chain=self.model.chain)
        values = np.append(self.values[: len(drift.names) - 1], 0.0)
        # A drift of 1 µm/h, all touches an hour after a first one: it has moved the tool by 1 µm.
        data = self.data[np.append(0, np.arange(len(self.data)))]
        moves = drift.moves(
            data.with_columns(time_s=np.append(0.0, np.full(len(self.data), HOUR_S)))
        )
        column = np.asarray(drift.core.rates(moves, values[None], [len(values) - 1])).reshape(-1)
        return column[1:]

    def placed(self, name: str) -> Floats:
        """As a parameter of the placement, by its name, is larger by 1."""
        at, moves = self.model.names.index(name), self.model.moves(self.data)
        return np.asarray(self.model.core.rates(moves, self.values[None], [at])).reshape(-1)


def on_machine(effect: Any, model: TouchModel, data: Touches, values: Floats) -> Any:
    """Return what changes touches by a user's effect: one that is an angle asks for the machine."""
    made = getattr(effect, "on_machine", None)
    return effect if made is None else made(OnMachine(model, data, values))


def _rotary_steps(
    model: TouchModel, moves: Moves, positions: Mapping[str, Floats], values: Floats
) -> Iterator[Input]:
    """Rounding of the commands to each rotary axis: the same in all touches of one position of it.

    However often the other axes turn meanwhile, and the axis comes back.
    """
    step = model.setup.resolution.rotary_arcsec
    if step <= 0:
        return
    for letter, change in turning(model, moves, values).items():
        distinct, at = positions_of(positions[letter])
        columns = np.where(at[:, None] == np.arange(len(distinct)), change[:, None], 0.0)
        name, keys = f"steps of the {letter.upper()} axis", tuple(distinct.tolist())
        yield Input(name, step / np.sqrt(12), "arcsec", columns, "rectangular", keys)
