#!/usr/bin/python3
"""Drives LinuxCNC instead of a screen: MDI lines and programs one after the other, to a report.

Run by LinuxCNC with the system's Python, as [DISPLAY] of the INI file; reads job.json beside it.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import hal  # type: ignore[import-not-found]
import linuxcnc  # type: ignore[import-not-found]

HERE = Path(__file__).parent
PINS = ("strikes", "stem-strikes", "deepest", "struck-depth", "touches")


def main() -> None:
    job = json.loads((HERE / "job.json").read_text())
    bench = Bench(float(job["seconds"]))
    try:
        bench.switch_on()
        steps = [bench.step(step) for step in job["steps"]]
    except TimeoutError as error:
        steps = [{"late": f"{error}: {bench.messages()}"}]
    (HERE / "report.json").write_text(json.dumps(steps))


class Bench:
    """One machine under a running LinuxCNC."""

    def __init__(self, seconds: float) -> None:
        self.end = time.monotonic() + seconds
        self.clocks: list[int] = []
        self.hal = hal.component("drive")
        self.hal.ready()
        self.command = linuxcnc.command()
        self.stat = linuxcnc.stat()
        self.errors = linuxcnc.error_channel()

    def wait(self, what: str, ready: Callable[[], bool]) -> None:
        while True:
            self.stat.poll()
            self.clocks.append(hal.get_value("motion-controller.time"))
            if ready():
                return
            if time.monotonic() > self.end:
                raise TimeoutError(what)
            time.sleep(0.002)

    def messages(self) -> list[str]:
        found = []
        while message := self.errors.poll():
            found.append(message[1].strip())
        return found

    def switch_on(self) -> None:
        self.command.state(linuxcnc.STATE_ESTOP_RESET)
        self.wait("estop reset", lambda: self.stat.task_state != linuxcnc.STATE_ESTOP)
        self.command.state(linuxcnc.STATE_ON)
        self.wait("machine on", lambda: self.stat.task_state == linuxcnc.STATE_ON)
        self.command.mode(linuxcnc.MODE_MANUAL)
        self.command.wait_complete()
        self.command.home(-1)
        self.wait("homing", lambda: sum(self.stat.homed[: self.stat.joints]) == self.stat.joints)
        hal.set_p("probebench.watch", "1")

    def begun(self, what: str) -> None:
        """Wait until the command has arrived: on a busy computer LinuxCNC is idle until then."""
        self.wait(what, lambda: self.stat.echo_serial_number >= self.command.serial)

    def idle(self) -> bool:
        s = self.stat
        return bool(
            s.interp_state == linuxcnc.INTERP_IDLE and s.state != linuxcnc.RCS_EXEC and s.inpos
        )

    def rest(self, what: str) -> None:
        """Wait until the joints stand: their interpolation ends some cycles after the path's."""
        before = None

        def stand() -> bool:
            nonlocal before
            last, before = before, self.stat.joint_position
            time.sleep(0.01)
            return bool(last == before)

        self.wait(what, stand)

    def step(self, step: dict[str, str]) -> dict[str, object]:
        started = time.monotonic()
        moving = hal.get_value("probebench.moving")
        travelled = hal.get_value("probebench.travelled")
        said, pauses = [], []
        self.clocks.clear()
        hal.set_p("motion-controller.tmax", "0")
        if "mdi" in step:
            self.command.mode(linuxcnc.MODE_MDI)
            self.command.wait_complete()
            self.command.mdi(step["mdi"])
            self.begun(step["mdi"])
            self.wait(step["mdi"], self.idle)
        else:
            self.command.mode(linuxcnc.MODE_AUTO)
            self.command.wait_complete()
            self.command.program_open(str(HERE / step["program"]))
            self.command.wait_complete()
            said += self.messages()
            self.command.auto(linuxcnc.AUTO_RUN, 0)
            self.begun(step["program"])

            def ready() -> bool:
                nonlocal said
                said += self.messages()
                if self.stat.interp_state == linuxcnc.INTERP_PAUSED:
                    said += self.messages()
                    pauses.append([len(said), [round(v, 4) for v in self.stat.joint_position[:5]]])
                    self.command.auto(linuxcnc.AUTO_RESUME)
                    time.sleep(0.02)
                    return False
                return self.idle()

            self.wait(step["program"], ready)
        self.rest("standstill")
        said += self.messages()
        report = {pin: hal.get_value(f"probebench.{pin}") for pin in PINS}
        # Of the servo cycles looked at, and the longest of all, in clocks of the processor.
        report["clocks"] = [median(self.clocks), hal.get_value("motion-controller.tmax")]
        report["joints"] = [round(v, 6) for v in self.stat.joint_position[:5]]
        report |= {key: step[key] for key in ("mdi", "program") if key in step}
        report["travel"] = hal.get_value("probebench.travelled") - travelled
        report["moving_seconds"] = hal.get_value("probebench.moving") - moving
        report["seconds"] = time.monotonic() - started
        report["messages"] = said
        report["pauses"] = pauses
        return report


if __name__ == "__main__":
    try:
        main()
    except Exception as error:
        (HERE / "report.json").write_text(json.dumps([{"error": repr(error)}]))
        raise
    sys.exit(0)
