"""Exceptions of trunnion. A message says what was wrong, got what, expected what, and where."""


class TrunnionError(ValueError):
    """Base of every error that trunnion raises on purpose.

    Attributes
    ----------
    entry
        Path of keys of the table entry that is wrong, where the error is about one: what has read
        the table from a file adds the place.
    """

    entry: tuple[str | int, ...] = ()


class InputError(TrunnionError):
    """An argument is not usable: out of range, wrong shape, not finite."""


class UnknownNameError(InputError):
    """A name (effect, preset, location error, key) that is in no list; the message has the list."""


class FileFormatError(TrunnionError):
    """A file that is not as the contract says; the message names file, line and column."""


class DataError(TrunnionError):
    """Readings that cannot belong to the model: too few, off the surface, or unrealistic."""


class KinematicsError(TrunnionError):
    """A pose that the machine or mechanism cannot take."""


class ProgramError(TrunnionError):
    """A part program that cannot be read or cut; the message names line and column."""
