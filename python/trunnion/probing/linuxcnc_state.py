"""What a probing program asks the control before its first move."""

from __future__ import annotations

from collections.abc import Iterator

from trunnion.data.frame import MODES, SAME_FRAME_MM
from trunnion.probing.cycle import Cycle
from trunnion.probing.linuxcnc_lines import fault_if, n
from trunnion.setup.control import WORK_OFFSETS

TOLERANCE_MM = 0.01
CORRECTION_MM = 2.0
"""Corrections of a machine are smaller; tool centre point control is further off."""
ROUNDED_DEG = 1e-4
"""Rotary work offsets are shown to this: less is rounding, and matters to no clearance."""
TURNING_PER_S = 0.05
"""Turns of the spindle in a second, as its encoder reads them, that are no noise of it."""
BEYOND_A_TURN_DEG = 400.0
"""Positions that LinuxCNC takes for an axis that counts on, and refuses for a wrapped one."""
LOOK_AT_PROBE = "look at the probe and start again"
TCP_IS_ON = "switch tool centre point control off, e.g. M429"


def state(cycle: Cycle) -> Iterator[str]:
    """Check the state of the control, without a move; not in a preview."""
    control, base = cycle.setup.control, offset_number(cycle)
    yield ""
    yield "(state of the control)"
    yield "#<known> = 1 (whether the frame of the runs before is known)"
    yield "#<restarted> = 0"
    yield "#<faults> = 0 (what is not as planned; all of it is said before the program stops)"
    yield "o100 if [#<_task> EQ 1]"
    yield "  M66 E0 L0 (waits for all that was commanded)"
    was_on = f"the spindle was on and is stopped, {LOOK_AT_PROBE}"
    yield from fault_if(130, "#<spindle_was_on> EQ 1", was_on)
    yield "  o131 if [EXISTS[#<_hal[spindle.0.speed-in]>]]"
    turns = f"ABS[#<_hal[spindle.0.speed-in]>] GT {n(TURNING_PER_S)}"
    yield from fault_if(132, turns, f"the spindle turns, {LOOK_AT_PROBE}")
    yield "  o131 endif"
    if control.tool_number:
        number = control.tool_number
        why = f"expected tool {number}, the probe"
        yield from fault_if(102, f"#5400 NE {number}", f"tool #5400 is in the spindle, {why}")
    offsets = " + ".join(f"ABS[#{5211 + i}]" for i in range(9))
    yield from fault_if(
        103, f"[#5210 EQ 1] AND [[{offsets}] GT 0]", "a G92 offset is active, G92.1 cancels it"
    )
    yield from fault_if(104, f"#{base + 9} NE 0", f"{control.wcs} is rotated by #{base + 9} deg")
    for label, letter in enumerate(cycle.letters, start=105):
        number = base + 3 + "ABC".index(letter)
        yield from fault_if(
            label, f"ABS[#{number}] GT {n(control.rotary_offset_deg + ROUNDED_DEG)}",
            f"{control.wcs} shifts {letter} by #{number} deg, the plan keeps clear of "
            f"{n(control.rotary_offset_deg)}: take it out or state control.rotary_offset_deg and "
            "plan again",
        )  # fmt: skip
    yield from _wrapped(cycle)
    yield "#<_unit> = 1 (mm of a unit of the machine)"
    yield "o120 if [#<_metric_machine> EQ 0]"
    yield "  #<_unit> = 25.4"
    yield "o120 endif"
    # #5403 is the length of the tool in the spindle, whether it is in force (G43) or not.
    yield f"#<length> = [#<_abs_z> - #5422 - #{base + 2} * #<_unit>]"
    if control.tool_check:
        why = "none is in force by G43, expected that to the centre of the ball"
        yield from fault_if(101, "#<length> LE 0.001", f"tool length #<length>: {why}")
    if control.centre_mm is not None:
        for i, (axis, value) in enumerate(zip("XYZ", control.centre_mm, strict=True)):
            yield f"#<at> = [#{base + i} * #<_unit>]"
            yield from fault_if(
                110 + i,
                f"ABS[#<at> - [{n(value)}]] GT {n(control.centre_tolerance_mm)}",
                f"{control.wcs} {axis} is #<at> mm, expected {n(value)} as in the set-up",
            )
    if control.tcp_check:
        yield from _identity(CORRECTION_MM if cycle.frame == "corrected" else TOLERANCE_MM)
    yield from _frame(cycle)
    yield "  o180 if [#<faults> GT 0]"
    yield "    M66 E0 L0 (the messages are shown before the queue is cleared)"
    yield "    (ABORT,%d nothing has moved: #<faults> not as planned, see the messages before)"
    yield "  o180 endif"
    yield "o100 endif"


def _identity(tolerance_mm: float) -> Iterator[str]:
    """Compare joints with machine coordinates where they stand."""
    yield "  o121 if [EXISTS[#<_hal[joint.0.pos-cmd]>]]"
    for joint, axis in enumerate("xyz"):
        far = f"ABS[#<_hal[joint.{joint}.pos-cmd]> * #<_unit> - #<_abs_{axis}>]"
        yield from fault_if(
            122 + joint, f"{far} GT {n(tolerance_mm)}",
            f"joint {joint} is not where {axis.upper()} is: {TCP_IS_ON}",
        )  # fmt: skip
    yield "  o121 else"
    yield "    (DEBUG, HAL pins cannot be read: make sure that TCP is off)"
    yield "  o121 endif"


def offset_number(cycle: Cycle) -> int:
    """Return the number of the parameter that has X of the work offset."""
    return 5201 + 20 * (1 + WORK_OFFSETS.index(cycle.setup.control.wcs))


def _wrapped(cycle: Cycle) -> Iterator[str]:
    """Stop where a rotary axis is wrapped, as it turns otherwise than planned.

    The INI file says it; where it cannot be read, or says it in words, a position beyond a turn
    does: LinuxCNC refuses that of a wrapped axis, with a message of its own. Nothing moves.
    """
    for i, letter in enumerate(cycle.letters):
        pin, o = f"#<_ini[axis_{letter.lower()}]wrapped_rotary>", 140 + 2 * i
        yield f"o{o} if [EXISTS[{pin}]]"
        yield from fault_if(
            o + 1, f"{pin} NE 0",
            f"WRAPPED_ROTARY of AXIS_{letter} in the INI file: {letter} would turn otherwise than "
            "planned, expected an axis that counts on",
        )  # fmt: skip
        yield f"o{o} endif"
    beyond = " ".join(f"{letter}{n(BEYOND_A_TURN_DEG)}" for letter in cycle.letters)
    # A G92 that was found in force is left to whoever reads the message.
    yield "o149 if [#<faults> EQ 0]"
    yield f"  G92 {beyond} (LinuxCNC refuses this for a wrapped axis; nothing moves)"
    yield "  G92.1"
    yield "o149 endif"


def frame_names(cycle: Cycle) -> tuple[str, ...]:
    """Return what the frame of a run is made of: words of the parameters that hold it."""
    return ("wcs", "mode", "x", "y", "z", "length", *(x.lower() for x in cycle.letters))


def plan_number(cycle: Cycle) -> int:
    """Return the hash of the plan as a number, which parameters can hold."""
    return int(cycle.plan_hash or "0", 16)


def _frame(cycle: Cycle) -> Iterator[str]:
    """Compare the frame with that of the runs that this one goes on with, where it is known."""
    base, before = offset_number(cycle), cycle.frame_before
    values = {"wcs": "#5220", "mode": str(MODES.index(cycle.frame)), "length": "#<length>"}
    values |= {axis: f"[#{base + i} * #<_unit>]" for i, axis in enumerate("xyz")}
    values |= {x.lower(): f"#{base + 3 + 'ABC'.index(x)}" for x in cycle.letters}
    names = frame_names(cycle)
    yield from (f"#<frame_{name}> = {values[name]}" for name in names)
    yield f"#<known> = {int(bool(before))} (frame of the runs before)"
    yield from (f"#<was_{name}> = {value:.6f}" for name, value in before.items())
    yield "#<restarted> = 1"
    yield "o150 if [EXISTS[#<_trunnion_plan>]]"
    yield "  #<restarted> = 0"
    if not before:
        yield f"  o151 if [#<_trunnion_plan> EQ {plan_number(cycle)}]"
        yield "    #<known> = 1"
        yield from (f"    #<was_{name}> = #<_trunnion_{name}>" for name in names)
        yield "  o151 endif"
    yield "o150 endif"
    yield "o152 if [[#<_from> GT 1] AND [#<known> EQ 1]]"
    for i, name in enumerate(names):
        if before and name not in before:
            continue
        yield from fault_if(
            160 + i, f"ABS[#<frame_{name}> - #<was_{name}>] GT {n(SAME_FRAME_MM)}",
            f"{_called(cycle, name)} is #<frame_{name}>, expected #<was_{name}> as in the run that "
            "this one continues: put it back, or measure from touch 1",
        )  # fmt: skip
    yield "o152 endif"


def _called(cycle: Cycle, name: str) -> str:
    """Return what people call a part of the frame."""
    called = {
        "wcs": "number of the work offset",
        "mode": "mode of the kinematics",
        "length": "tool length",
    }
    return called.get(name, f"{cycle.setup.control.wcs} {name.upper()}")
