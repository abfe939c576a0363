"""Turned passes from causes: what the diameters of a part would come out as."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, numbers, within
from trunnion.data.diameters import Diameters
from trunnion.diagnosis.effect import Values
from trunnion.models.diameters import Conditions, build
from trunnion.setup import Setup


@checked
def simulate_diameters(
    passes: Diameters,
    setup: Setup | Conditions,
    effects: Mapping[str, Mapping[str, float]],
    *,
    offset_um: float = 0.0,
    noise_um: float = 0.0,
    seed: int = 0,
) -> Diameters:
    """Turn passes with causes of diameter errors, and measure them.

    Parameters
    ----------
    passes
        Places and conditions of the cut: `z_mm`, and of `pass`, `feed_sign`, `depth_mm`, `time_s`
        and so on what is known. Their `error_um` is added to.
    setup
        With a table ``[turning]``.
    effects
        Id → parameter → value, as docs/reference/effects.md lists them for diameters:
        ``{"tool_heating": {"amplitude_um": 40.0, "tau_s": 30.0}}``. Parameters that are not
        given are 0.
    offset_um
        Setting of the tool, the same for all passes, on the diameter.
    noise_um, seed
        Standard deviation of a reading, and the seed of its noise.

    Returns
    -------
    Diameters
        The same passes with `error_um`, µm on the diameter.

    Raises
    ------
    UnknownNameError
        A cause, or a parameter of one, that does not exist.
    DataError, InputError
        Passes beyond the overhang, a set-up without ``[turning]``; noise below 0.

    Examples
    --------
    >>> import numpy as np
    >>> import trunnion as tn
    >>> setup = tn.Setup(artefact=tn.Artefact("none"), turning={"overhang_mm": 60.0})
    >>> passes = tn.Diameters({"z_mm": np.arange(60.0, 0.0, -5.0), "error_um": np.zeros(12)})
    >>> made = tn.simulate_diameters(passes, setup, {"bending": {"tip_um": 10.0}})
    >>> float(made["error_um"][0])
    10.0
    """
    within("noise_um", noise_um, 0.0)
    known = {effect.id: effect for effect in build(passes, setup).effects}
    error = np.asarray(passes.error_um, dtype=np.float64) + offset_um
    for name, given in effects.items():
        effect = known[choose("cause of a diameter error", name, known)]
        names = [parameter.name for parameter in effect.parameters]
        for parameter in given:
            choose(f"parameter of {name}", parameter, names)
        values = Values(dict.fromkeys(names, 0.0) | numbers(name, given))
        error = error + np.asarray(effect.change(values), dtype=np.float64)
    noise = np.random.default_rng(seed).normal(0.0, noise_um, len(error)) if noise_um else 0.0
    return passes.with_columns(error_um=error + noise)
