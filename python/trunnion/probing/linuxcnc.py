"""The text of a probing cycle: checks of the control, one subroutine and a call a touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trunnion.probing.cycle import BACK_OFF_DEG, CHECK_DEG, CHECK_MM, SHORTEST_PROBE_MM, Cycle
from trunnion.probing.linuxcnc_lines import comment, end, n, own, protected, stop_if
from trunnion.probing.linuxcnc_state import (
    TCP_IS_ON,
    frame_names,
    offset_number,
    plan_number,
    state,
)
from trunnion.probing.notes import assumptions, fast_approaches

TELLS_MM = 0.1
"""Joints that move otherwise than X by more than this are under tool centre point control."""
HIGHEST_RISE_MM = 2000.0
"""Limits of Z that are further away are none."""
SAME_READING_MM = "0.000000001"
"""Readings of two approaches never agree so far; one that was not renewed agrees exactly."""


TELL_EVERY = 10
"""Touches of one posture between messages: those of each would cover all others of the control."""


def program_text(cycle: Cycle) -> str:
    """Return the program of a cycle."""
    parts = (_header, _settings, state, _turn_sub, _touch_sub, _look_sub, _begin, _calls, _finish)
    return "\n".join(line for part in parts for line in part(cycle)) + "\n"


def _header(cycle: Cycle) -> Iterator[str]:
    yield from (comment(said) for said in _said(cycle))


def _said(cycle: Cycle) -> Iterator[str]:
    """What the header says, a comment each."""
    setup, control = cycle.setup, cycle.setup.control
    yield f"trunnion: {len(cycle.steps)} touches of plan {cycle.name}, hash {cycle.plan_hash}"
    yield (
        f"machine {setup.machine.name}, {setup.artefact.kind}, ball radius"
        f" {n(setup.probe.ball_radius_mm)} mm, clearance {n(setup.plan.clearance_mm)} mm"
    )
    yield f"origin, {control.wcs}: centre of the table top, on the axis of the table"
    if control.centre_mm is not None:
        x, y, z = (n(v) for v in control.centre_mm)
        yield f"in machine coordinates X{x} Y{y} Z{z}, to {n(control.centre_tolerance_mm)} mm"
    yield "tool length: to the CENTRE of the ball, not to its tip"
    kinematics = "identity kinematics, no TCP or trunnion kinematics"
    if cycle.frame == "corrected":
        kinematics = f"machine coordinates with corrections: {cycle.mode}"
    elif cycle.frame == "table":
        on = cycle.setup.control.tcp_on
        kinematics = f"TCP on for the approaches alone: {on}, {cycle.mode}"
    yield f"state of the control: homed, {kinematics},"
    yield "no G92, no rotation of the work offset, spindle at rest"
    yield "rotary axes count on behind a turn: no WRAPPED_ROTARY"
    ranges = ", ".join(f"{x} {n(low)} to {n(high)}" for x, (low, high) in cycle.ranges().items())
    yield f"ranges in {control.wcs}: {ranges}"
    yield from cycle.said_before()
    yield from assumptions(setup)
    yield from cycle.notes
    yield from fast_approaches([step.feed for step in cycle.steps], setup)
    yield f"time: about {cycle.times()[1] / 60:.1f} min without pauses"
    yield f"log: {cycle.log}"


def _settings(cycle: Cycle) -> Iterator[str]:
    plan, control = cycle.setup.plan, cycle.setup.control
    yield ""
    yield f"#<_from> = {cycle.start_at} (first touch, to go on with a run that was stopped)"
    yield f"#<_dry> = {int(cycle.dry_run)} (1: dry run, all moves but the approaches)"
    yield "#<_on_miss> = 0 (a touch that finds nothing: 0 stop, 1 go on with the next)"
    yield f"#<_down> = {n(control.positioning_mm_min)} (feed down to a start, stops on contact)"
    yield f"#<_slow> = {n(plan.slow_feed_mm_min)} (feed of the second pass; 0: one pass)"
    yield f"#<_back_off> = {n(control.back_off_mm)} (before the second pass)"
    yield f"#<_swing> = {n(cycle.swing)} (Z above all that swings)"
    yield "#<_tell> = 0 (touch from which on one is said again)"
    yield ""
    yield "G21 G17 G40 G80 G90 G94 G61"
    yield control.wcs
    if control.tool_number:
        yield f"G43 H{control.tool_number}"
    yield "#<spindle_was_on> = #<_spindle_on>"
    yield "M5"
    yield "M9"
    if cycle.mode:
        yield cycle.mode


def _turn_sub(cycle: Cycle) -> Iterator[str]:
    """Turn the rotary axes: position and expected sense of each, 0 = any."""
    control = cycle.setup.control
    yield ""
    yield f"(turn: {', '.join(f'{x}, its sense' for x in cycle.letters)}; touch)"
    yield "o<turn> sub"
    yield "#<moves> = 0"
    yield "#<overs> = 0"
    for i, letter in enumerate(cycle.letters):
        to, expected, name = f"#{2 * i + 1}", f"#{2 * i + 2}", letter.lower()
        o = 200 + 10 * i
        yield f"#<way> = [{to} - #<_{name}_at>]"
        yield f"#<over_{name}> = 0"
        yield f"o{o} if [ABS[#<way>] GE 0.000001]"
        yield "  #<moves> = 1"
        yield f"  o{o + 1} if [#<way> * {expected} LT 0]"
        yield f"    #<over_{name}> = {expected}"
        yield f"  o{o + 1} endif"
        yield f"  #<_{name}_sense> = {expected}"
        yield f"  o{o + 2} if [{expected} EQ 0]"
        yield f"    #<_{name}_sense> = [#<way> / ABS[#<way>]]"
        yield f"  o{o + 2} endif"
        yield f"o{o} elseif [[{expected} NE 0] AND [#<_{name}_sense> NE {expected}]]"
        yield f"  #<over_{name}> = {expected}"
        yield f"  #<_{name}_sense> = {expected}"
        yield f"o{o} endif"
        yield f"#<overs> = [#<overs> + ABS[#<over_{name}>]]"
        yield f"#<_{name}_at> = {to}"
    overshoot = " ".join(
        f"{x}[#{2 * i + 1} - {n(BACK_OFF_DEG)} * #<over_{x.lower()}>]"
        for i, x in enumerate(cycle.letters)
    )
    plain = " ".join(f"{x}#{2 * i + 1}" for i, x in enumerate(cycle.letters))
    number = 2 * len(cycle.letters) + 1
    yield "o290 if [#<moves> + #<overs> GT 0]"
    yield "  o291 if [#5422 LT #<_swing> - 0.00005]"
    yield "    G0 Z#<_swing>"
    yield "  o291 endif"
    yield from own(control.before_turn)
    yield "  o292 if [#<overs> GT 0]"
    yield f"    G0 {overshoot}"
    yield "  o292 endif"
    yield f"  G0 {plain}"
    yield from own(control.after_turn)
    yield "  #<_tell> = 0"
    yield "o290 endif"
    yield from _progress(cycle, f"#{number}")
    yield "o<turn> endsub"


def _progress(cycle: Cycle, number: str) -> Iterator[str]:
    """Say which touch comes, where a posture begins and every `TELL_EVERY` touches of one."""
    many, minutes = len(cycle.steps), cycle.times()[1] / 60
    at = " ".join(f"{letter}#<_{letter.lower()}_at>" for letter in cycle.letters)
    places = max((_decimals(v) for step in cycle.steps for v in step.angles.values()), default=0)
    yield f"o295 if [{number} GE #<_tell>]"
    yield f"  #<left> = FUP[{minutes:.2f} * [{many + 1} - {number}] / {many}]"
    yield f"  (DEBUG,%d touch {number} of {many},%.{places}f {at},%.0f about #<left> min left)"
    yield f"  #<_tell> = [{number} + {TELL_EVERY}]"
    yield "o295 endif"


def _decimals(value: float) -> int:
    """Return how many decimals of a position there are."""
    return len(n(value).partition(".")[2])


def _touch_sub(cycle: Cycle) -> Iterator[str]:
    """One touch."""
    turn = " ".join(f"[#{2 + i}]" for i in range(2 * len(cycle.letters)))
    first = 2 + 2 * len(cycle.letters)
    x, y, z, to_x, to_y, to_z, level, feed = (f"#{first + i}" for i in range(8))
    yield ""
    senses = ", ".join(f"{a}, its sense" for a in cycle.letters)
    more = ", way X Y Z on the table" if cycle.frame == "table" else ""
    yield f"(touch: number, {senses}, start X Y Z, end X Y Z, level, feed{more})"
    yield "o<touch> sub"
    yield "o300 if [#1 LT #<_from>]"
    yield "  o<touch> return"
    yield "o300 endif"
    yield f"o<turn> call {turn} [#1]"
    yield f"o301 if [ABS[#5420 - {x}] + ABS[#5421 - {y}] GT 0.00005]"
    yield f"  G0 X{x} Y{y}"
    yield "o301 endif"
    yield f"o302 if [#5422 - {z} GT {n(SHORTEST_PROBE_MM)}]"
    yield f"  G38.3 Z{z} F#<_down>"
    yield "  o303 if [[#<_task> EQ 1] AND [#5070 EQ 1]]"
    yield from end("touch #1: contact on the way down to its start, Z %.3f#5063", "    ")
    yield "  o303 endif"
    yield f"o302 elseif [#5422 - {z} GT 0.00005]"
    yield f"  G0 Z{z}"
    yield "o302 endif"
    if cycle.frame == "table":
        yield cycle.setup.control.tcp_on
        for i, axis in enumerate("xyz"):
            yield f"#<start_{axis}> = #{5420 + i}"
            yield f"#<end_{axis}> = [#<start_{axis}> + #{first + 8 + i}]"
        yield from _approach(
            [f"#<{end}_{axis}>" for end in ("start", "end") for axis in "xyz"], feed
        )
        yield cycle.mode
    else:
        yield from _approach([x, y, z, to_x, to_y, to_z], feed)
    yield f"o307 if [{level} - {z} GT 0.00005]"
    yield f"  G0 Z{level}"
    yield "o307 endif"
    yield "o308 if [#<stale> EQ 1]"
    why = "the control gave the reading of the approach before it, start again from this touch"
    yield from end(f"touch #1: {why}")
    yield "o308 endif"
    yield "o309 if [#<hit> EQ 0]"
    yield "  o310 if [#<_on_miss> EQ 0]"
    yield from end("touch #1: no contact up to the end of its approach", "    ")
    yield "  o310 endif"
    yield "  (DEBUG,%d touch #1: no contact up to the end of its approach, going on)"
    yield "o309 endif"
    yield "o<touch> endsub"


def _approach(places: Sequence[str], feed: str) -> Iterator[str]:
    """The approach from a start to its end (X Y Z each), once or twice, and the way back."""
    x, y, z, to_x, to_y, to_z = places
    yield "#<hit> = 1"
    yield "#<stale> = 0"
    yield "o304 if [#<_dry> EQ 0]"
    yield "  M50 P0 (the feed is what the override cannot change)"
    yield f"  G38.3 X{to_x} Y{to_y} Z{to_z} F{feed}"
    yield "  #<hit> = [[#<_task> EQ 0] OR [#5070 EQ 1]]"
    yield from _renewed()
    yield f"  #<feed> = {feed}"
    yield "  o305 if [#<hit> AND [#<_task> EQ 1] AND [#<_slow> GT 0] AND [#<stale> EQ 0]]"
    yield f"    #<x> = [{x} - {to_x}]"
    yield f"    #<y> = [{y} - {to_y}]"
    yield f"    #<z> = [{z} - {to_z}]"
    yield "    #<way> = [#<_back_off> / SQRT[#<x> * #<x> + #<y> * #<y> + #<z> * #<z>]]"
    yield "    G0 X[#5061 + #<way> * #<x>] Y[#5062 + #<way> * #<y>] Z[#5063 + #<way> * #<z>]"
    yield f"    G38.3 X{to_x} Y{to_y} Z{to_z} F#<_slow>"
    yield "    #<hit> = #5070"
    yield from _renewed()
    yield "    #<feed> = #<_slow>"
    yield "  o305 endif"
    positions = " ".join(f"#{5061 + i}" for i in range(6))
    yield "  o306 if [#<hit> AND [#<_task> EQ 1] AND [#<stale> EQ 0]]"
    yield f"    (LOG,%d#1 %.6f#<feed> {positions})"
    yield "  o306 endif"
    yield "  M50 P1"
    yield f"  G0 X{x} Y{y} Z{z}"
    yield "o304 endif"


def _renewed() -> Iterator[str]:
    """See whether a contact has its own reading, not that of the approach before it."""
    far = " + ".join(f"ABS[#{5061 + i} - #<_{axis}_read>]" for i, axis in enumerate("xyz"))
    yield f"  #<stale> = [[#<_task> EQ 1] AND #<hit> AND [[{far}] LT {SAME_READING_MM}]]"
    yield from (f"  #<_{axis}_read> = #{5061 + i}" for i, axis in enumerate("xyz"))


def _begin(cycle: Cycle) -> Iterator[str]:
    control, base = cycle.setup.control, offset_number(cycle)
    yield ""
    yield f"(DEBUG,plan {cycle.name}, {len(cycle.steps)} touches)"
    yield f"(DEBUG,%.2f {control.wcs} is at machine X#{base} Y#{base + 1} Z#{base + 2})"
    yield "(DEBUG,%.1f from the centre of the table top the ball is now X#5420 Y#5421 Z#5422 mm)"
    yield from _going_on(cycle)
    expected = "corrections on" if cycle.frame == "corrected" else "TCP off"
    yield f"(MSG,look whether it is; spindle at rest, {expected}? then cycle start)"
    yield "M0"
    yield from (line.strip() for line in own(control.probe_on))
    yield from _rise(cycle)
    yield from (f"#<_{axis}_read> = 999999 (no reading yet)" for axis in "xyz")
    for letter in cycle.letters:
        yield f"#<_{letter.lower()}_at> = 0"
        yield f"#<_{letter.lower()}_sense> = 0"
    yield from (line.strip() for line in own(control.before_turn))
    yield "G0 " + " ".join(f"{letter}0" for letter in cycle.letters)
    if cycle.checks_tcp:
        yield from _tcp_move()
    yield from (line.strip() for line in own(control.after_turn))
    yield from _first_looks(cycle)
    yield "#<_up> = #<_swing>"
    yield "o410 if [[#<_task> EQ 1] AND [#<_dry> EQ 0]]"
    yield f"  (LOGAPPEND,{cycle.log})"
    yield (
        f"  (LOG,%d trunnion-touches 1 plan={cycle.name} hash={cycle.plan_hash}"
        f" touches={len(cycle.steps)} from=#<_from>)"
    )
    at = " ".join(f"#<frame_{name}>" for name in "xyz")
    rotary = "".join(f" {x} #<frame_{x.lower()}>" for x in cycle.letters)
    yield f"  (LOG,; {control.wcs} {at} tool length #<length>{rotary} {cycle.frame})"
    yield f"  #<_trunnion_plan> = {plan_number(cycle)} (what the next run is compared with)"
    yield from (f"  #<_trunnion_{name}> = #<frame_{name}>" for name in frame_names(cycle))
    yield "o410 endif"


def _going_on(cycle: Cycle) -> Iterator[str]:
    """Say what to compare where the control cannot, before cycle start is asked for."""
    names = [name for name in frame_names(cycle) if name not in ("wcs", "mode", "length")]
    frame = " ".join(f"{name.upper()} #<frame_{name}>" for name in names)
    yield "o403 if [[#<_from> GT 1] AND [#<known> EQ 0]]"
    yield "  (DEBUG,%d from touch #<_from> on; the frame of the runs before is not known here)"
    yield "  (DEBUG,compare: the line of the log with a semicolon must say, to 0.0001 mm and deg)"
    yield f"  (DEBUG,%.4f {cycle.setup.control.wcs} {frame} tool length #<length>)"
    yield "o403 endif"
    yield "o404 if [[#<_from> GT 1] AND [#<restarted> EQ 1]]"
    yield "  (DEBUG,no run since this control started: homing moves zeros, which nothing here sees)"
    yield "o404 endif"


def _rise(cycle: Cycle) -> Iterator[str]:
    """Rise above all that swings; where nobody stated the work offset, as high as the axis goes."""
    if cycle.setup.control.centre_mm is None:
        yield "o401 if [[#<_task> EQ 1] AND [EXISTS[#<_ini[axis_z]max_limit>]]]"
        yield "  #<top> = [#<_ini[axis_z]max_limit> * #<_unit> - 0.01]"
        yield f"  o402 if [[#<top> GT #<_abs_z>] AND [#<top> - #<_abs_z> LT {n(HIGHEST_RISE_MM)}]]"
        yield "    G53 G0 Z#<top>"
        yield "  o402 endif"
        yield "o401 endif"
    yield "o400 if [#5422 LT #<_swing> - 0.00005]"
    yield "  G0 Z#<_swing>"
    yield "o400 endif"
    yield "#<_up> = #5422 (where to rise to on a contact)"


def _tcp_move() -> Iterator[str]:
    """With C turned a little X must move joint 0 alone; then C comes back."""
    yield f"G0 C{n(CHECK_DEG)}"
    yield f"#<step> = {n(CHECK_MM)}"
    yield "o420 if [#5420 GT 0.00005]"
    yield "  #<step> = [0 - #<step>]"
    yield "o420 endif"
    yield "o421 if [#<_task> EQ 1]"
    yield "  M66 E0 L0"
    yield "  o422 if [EXISTS[#<_hal[joint.0.pos-cmd]>]]"
    yield from (f"    #<joint_{i}> = #<_hal[joint.{i}.pos-cmd]>" for i in range(2))
    yield "  o422 endif"
    yield "o421 endif"
    yield "G0 X[#5420 + #<step>]"
    yield "o423 if [#<_task> EQ 1]"
    yield "  M66 E0 L0"
    yield "  o424 if [EXISTS[#<_hal[joint.0.pos-cmd]>]]"
    for i, axis in enumerate("xy"):
        yield f"    #<{axis}> = [[#<_hal[joint.{i}.pos-cmd]> - #<joint_{i}>] * #<_unit>]"
    yield from stop_if(
        425, f"ABS[#<x> - #<step>] + ABS[#<y>] GT {n(TELLS_MM)}",
        f"with X by #<step> at C{n(CHECK_DEG)} joints 0 and 1 moved #<x> and #<y>: {TCP_IS_ON}",
    )  # fmt: skip
    yield "  o424 endif"
    yield "o423 endif"
    yield "G0 C0"
    yield "#<_c_sense> = -1"


def _first_looks(cycle: Cycle) -> Iterator[str]:
    """Go over the table and touch the artefact, ready to stop, before anything turns far."""
    yield from protected(500, "X0 Y0", "ABS[#5420] + ABS[#5421]", "on the way to X0 Y0")
    if not cycle.looks:
        return
    yield "o510 if [#<_dry> EQ 0]"
    for look in cycle.looks:
        values = (*look.start, *look.end, *look.contact, *look.towards)
        values += (cycle.look_mm(look), look.feed)
        yield "  o<look> call " + " ".join(f"[{n(v)}]" for v in values)
    yield "o510 endif"


def _look_sub(cycle: Cycle) -> Iterator[str]:
    """Touch once where it is planned, and stop the program where it is not as planned."""
    if not cycle.looks:
        return
    why = f"{cycle.setup.control.wcs}, tool length or artefact are not as planned"
    yield ""
    yield "(look: start X Y Z, end X Y Z, contact X Y Z, direction X Y Z, to mm, feed)"
    yield "o<look> sub"
    way = "ABS[#5420 - #1] + ABS[#5421 - #2]"
    yield from protected(520, "X#1 Y#2", way, "on the way to the artefact")
    what = f"on the way down to the artefact, free down to Z%.4f#3 as planned: {why}"
    yield from protected(523, "X#1 Y#2 Z#3", "#5422 - #3", what)
    yield "G38.3 X#4 Y#5 Z#6 F#14"
    yield "#<off> = [" + " + ".join(f"[#{5061 + i} - #{7 + i}] * #{10 + i}" for i in range(3)) + "]"
    yield "o526 if [#<_task> EQ 1]"
    yield "  o527 if [#5070 EQ 0]"
    planned = "X%.4f#7 Y#8 Z#9"
    yield from end(f"no contact at {planned} nor behind: {why}", "    ")
    yield "  o527 elseif [ABS[#<off>] GT #13]"
    far = f"#<off> mm behind {planned}, expected within #13 mm"
    yield from end(f"contact %.2f{far}: {why}", "    ")
    yield "  o527 endif"
    yield "o526 endif"
    yield "G0 X#1 Y#2 Z#3"
    yield "G0 Z#<_swing>"
    yield "o<look> endsub"


def _calls(cycle: Cycle) -> Iterator[str]:
    yield ""
    for number, step in enumerate(cycle.steps, start=1):
        rotary = [v for x in cycle.letters for v in (step.angles[x], step.senses[x])]
        values = [number, *rotary, *step.start, *step.end, step.level, step.feed]
        values += step.way if cycle.frame == "table" else ()
        yield "o<touch> call " + " ".join(f"[{n(v)}]" for v in values)


def _finish(cycle: Cycle) -> Iterator[str]:
    control = cycle.setup.control
    yield ""
    yield "o430 if [#5422 LT #<_swing> - 0.00005]"
    yield "  G0 Z#<_swing>"
    yield "o430 endif"
    yield "(LOGCLOSE)"
    turned = " + ".join(f"ABS[#<_{letter.lower()}_at>]" for letter in cycle.letters)
    yield f"o431 if [{turned} GT 0]"
    yield from own(control.before_turn)
    yield "  G0 " + " ".join(f"{letter}0" for letter in cycle.letters)
    yield from own(control.after_turn)
    yield "o431 endif"
    yield from (line.strip() for line in own(control.probe_off))
    yield "o432 if [#<_dry> EQ 0]"
    yield f"  (DEBUG,done, touches are in {cycle.log})"
    yield "o432 else"
    yield "  (DEBUG,dry run done)"
    yield "o432 endif"
    yield "M2"
