"""What made a result: the command that runs, for the record of reports."""

from contextvars import ContextVar

COMMAND: ContextVar[str] = ContextVar("command", default="")
"""The command line that runs; empty in a program."""
