"""Axis logs on the diagnosis engine: what in the servo model is wrong.

A reading is an actual axis position less what the servo model of the set-up's ``[servo]`` table
says for the commanded positions, in µm or arcsec. Axes are taken as controlled independently: in a
cross-coupled control the commands to log are those that the position loops get.

Readings are means over blocks of samples (as many as keep some thousand readings), predictions
likewise. Noise is divided out axis by axis and, where what no servo effect can make is
autocorrelated, whitened by an autoregression (:mod:`trunnion.diagnosis.noise`); readings that
wander have a covariance of their own (:mod:`trunnion.diagnosis.wander`).

The response of an axis is simulated exactly (:mod:`trunnion.contouring`). Each effect's column is a
chord of it (:mod:`.servo_effects`). A single effect is thus compared and sized without any
linearisation; of several on one axis, what one does to the other's column is left out, which is of
second order (1 % of gain with 0.3 ms of time constant: 0.05 µm). Where that is not small beside
what is left, strong effects are fitted jointly and all columns are taken about them (:mod:`.near`).

Where two effects look alike:

- e = v/K + a (τ/K - 1/K²): a gain mismatch goes with the velocity, a time-constant mismatch with
  the acceleration; a delay in the loop is like a time constant, a stiff structure likewise;
- a delay of the log is like a gain mismatch of one axis, but shows in all axes;
- backlash and Coulomb friction both lie on the side that the axis comes from, and differ at
  reversals and at the start only; at one feed a gain mismatch is like backlash: log two feeds;
- a rotary axis out of place is not identifiable from axis positions. It is from the tool tip
  measured in the table's frame (columns ``tip_x_mm``, ``tip_y_mm``, ``tip_z_mm``).

:mod:`.inputs` has further columns of the log, :mod:`.signals` the readings and the servo model's
responses, :mod:`.effects` the table of effects, :mod:`.columns` what its entries are made of,
:mod:`.checks` what a log must be, :mod:`.steps` what rounded positions do, :mod:`.model` what the
engine asks.
"""

from trunnion.models.axis_log.model import AxisLogModel as AxisLogModel
from trunnion.models.axis_log.model import ExtendedServo as ExtendedServo
from trunnion.models.axis_log.model import build as build
