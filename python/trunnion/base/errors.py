"""Exceptions of trunnion. A message says what was wrong, got what, expected what, and where."""


class TrunnionError(ValueError):
    """Base of every error that trunnion raises on purpose.

    Attributes
    ----------
    entry
        Path of keys of the table entry that is wrong, where the error is about one: what has read
        the table from a file adds the place.

    Examples
    --------
    >>> import trunnion as tn
    >>> try:
    ...     tn.Artefact("cube")
    ... except tn.TrunnionError as error:
    ...     print(str(error)[-20:])
    ...
    did you mean cuboid?
    """

    entry: tuple[str | int, ...] = ()


class InputError(TrunnionError):
    """An argument is not usable: out of range, wrong shape, not finite.

    Examples
    --------
    >>> import trunnion as tn
    >>> try:
    ...     tn.Probe(ball_radius_mm=-1.0)
    ... except tn.InputError as error:
    ...     print(error)
    ...
    probe.ball_radius_mm: got -1.0, expected a number from 0.001 to 100000 mm
    """


class UnknownNameError(InputError):
    """A name (effect, preset, location error, key) that is in no list; the message has the list.

    Examples
    --------
    >>> import trunnion as tn
    >>> try:
    ...     tn.sample_path("cross/setup.tml")
    ... except tn.UnknownNameError as error:
    ...     print(str(error)[:60])
    ...
    sample: got 'cross/setup.tml', expected one of axis/arc.csv,
    """


class FileFormatError(TrunnionError):
    """A file that is not as the contract says; the message names file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> from pathlib import Path
    >>> _ = Path("setup.toml").write_text("[probe")
    >>> try:
    ...     tn.read_setup("setup.toml")
    ... except tn.FileFormatError as error:
    ...     print(str(error)[:51])
    ...
    setup.toml:1:7: got '[probe', expected TOML: Expect
    """


class DataError(TrunnionError):
    """Readings that cannot belong to the model: too few, off the surface, or unrealistic.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> try:
    ...     tn.identify(touches[:5], setup)
    ... except tn.DataError as error:
    ...     print(str(error)[:60])
    ...
    touches.csv: got 5 touches and 0 priors for 14 parameters; e
    """

    cause_known = False
    """Whether its message names the likely cause, and no other is sought."""


class TooFewReadingsError(DataError):
    """Fewer readings than unknowns.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> try:
    ...     tn.diagnose(touches[:5], setup)
    ... except tn.DataError as error:
    ...     print(error)
    ...
    touches.csv: readings: got 5 for 14 unknowns, expected more than unknowns
    """


class KinematicsError(TrunnionError):
    """A pose that the machine or mechanism cannot take.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"), tn.Machine("trt-ca"))
    >>> try:
    ...     tn.inverse_kinematics(setup, [0, 0, 0], [0, 0, 1], errors={"EB0C": 3600.0})
    ... except tn.KinematicsError as error:
    ...     print(str(error)[:70])
    ...
    row 0: no axis positions reach the tool direction (0.000000, 0.000000,
    """


class ProgramError(TrunnionError):
    """A part program that cannot be read or cut; the message names line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> try:
    ...     tn.nc.Program.parse("G1 X", "linuxcnc")
    ... except tn.ProgramError as error:
    ...     print(str(error)[:36])
    ...
    line 1, column 4: X without a number
    """
