"""The Rust core. Flat and thin; use the functions of :mod:`trunnion` instead."""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, TypedDict, final

import numpy as np
import numpy.typing as npt

__all__ = ["MAX_THREADS", "RANK_TOLERANCE", "__version__"]

MAX_THREADS: int
RANK_TOLERANCE: float
__version__: str

# --- trunnion
__all__ += [
    "Arrangement",
    "Artefact",
    "Machine",
    "Measurements",
    "Moves",
    "TouchModel",
    "artefact_kinds",
    "catalogue",
    "closed_form_slips",
]

_Floats: TypeAlias = npt.NDArray[np.float64]
_Integers: TypeAlias = npt.NDArray[np.int64]
_Flags: TypeAlias = npt.NDArray[np.bool_]
_Kind: TypeAlias = Literal["linear", "moment", "duration"]

# --- statistics
__all__ += ["CauseBlocks", "CauseSet", "gains_of_blocks", "linear_fit", "sizes_of_sets"]
__all__ += ["local_errors_inside", "sums_by_value"]

def linear_fit(
    columns: _Floats, values: _Floats, hold: Sequence[bool], tolerance: float, basis: bool
) -> tuple[_Floats, _Floats, int, _Floats, _Flags, _Flags, _Floats, _Floats, _Floats]:
    """What the fields of trunnion.base.statistics.LinearFit hold, in their order."""

def gains_of_blocks(
    gram: _Floats, basis: _Floats, residuals: _Floats, dependent: float
) -> tuple[_Floats, _Integers]:
    """Gains of blocks (b, s), and how many columns each adds (b,)."""

def sums_by_value(values: _Integers, count: int, weights: _Floats, columns: _Floats) -> _Floats:
    """Sums over the readings of each value, of weights (c, n) times columns (n, s)."""

def local_errors_inside(values: _Floats, errors: _Floats, period: float | None) -> _Flags:
    """Which places and widths (m, 2) have several of some distinct values, and some beside them."""

@final
class CauseSet:
    """A set of blocks of candidates, by its inner products with their columns."""

    @property
    def rss(self) -> float: ...
    @property
    def penalty(self) -> float: ...
    @property
    def columns(self) -> int: ...
    def products(self) -> tuple[_Floats, _Floats]: ...

@final
class CauseBlocks:
    """The blocks of all candidates, and what sets of them cost."""

    def __new__(
        cls,
        *,
        width: int,
        start: Sequence[int],
        rank: Sequence[int],
        candidate: Sequence[int],
        penalty: _Floats,
        positive: Sequence[bool],
        dependent: float,
        degrees_of_freedom: int,
        floor: float,
        least: float,
    ) -> CauseBlocks: ...
    def empty(self, residual: _Floats, rss: float) -> CauseSet: ...
    def extended(self, before: CauseSet, block: int, products: _Floats) -> CauseSet: ...
    def gains_beside(
        self, empty: CauseSet, blocks: Sequence[tuple[int, _Floats]], first: int, end: int
    ) -> tuple[float, _Floats]: ...
    def tried(
        self, sets: Sequence[CauseSet], best: float, reach: float, many: int
    ) -> list[tuple[float, int, int, float, int]]:
        """Score, number of the set, block, sum of squares, count of columns; best first."""

def sizes_of_sets(
    sets: Sequence[Sequence[int]],
    *,
    rank: Sequence[int],
    counted: Sequence[bool],
    gram: _Floats,
    residual: _Floats,
    dependent: float,
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Gain and log determinant of each set; log determinant and length of each of its blocks."""

_Method: TypeAlias = Literal["separating", "printed", "identified"]
_Feedback: TypeAlias = Literal["motor", "load"]
# Feed mm/min, acceleration time s, decelerate, normal acceleration mm/s², dwell s.
_Feed: TypeAlias = tuple[float, float, bool, float, float]
# Contour-error model, orientation-error model, gains (5, 3), order of controller and Jacobian.
_Coupling: TypeAlias = tuple[
    Literal["circle", "tangent"],
    Literal["proposed", "tangent"],
    _Floats,
    Literal["controller_last", "jacobian_last", "as_printed"],
]

def artefact_kinds() -> dict[str, list[float]]:
    """Kinds of artefact: dimensions (mm, in order) of an example of each."""

def closed_form_slips() -> list[str]: ...
def catalogue(
    machine: Machine, kind: str, dimensions: Sequence[float]
) -> list[tuple[str, str, str, list[tuple[str, str, _Kind]], list[str]]]:
    """Effects on touches: id, title, owner, parameters (name, unit, kind), columns needed."""

@final
class Artefact:
    """What is touched, its nominal place on the table, and how far it may stand off."""

    def __new__(
        cls,
        kind: str,
        dimensions: Sequence[float],
        *,
        place_mm: Sequence[float],
        turn_deg: float,
        stem_diameter_mm: float,
        base_mm: Sequence[float],
        clamps_mm: Sequence[Sequence[float]],
        chuck_mm: Sequence[float],
        tolerance_mm: float,
        tolerance_deg: float,
    ) -> Artefact: ...

@final
class Machine:
    """X, Y, Z and rotary axes, with location errors in µm and arcsec; angles in degrees."""

    def __new__(
        cls,
        chain: str,
        tool_length_mm: float,
        errors: Sequence[tuple[str, float]],
        *,
        directions: Sequence[tuple[str, Sequence[float]]] = ...,
        points_mm: Sequence[tuple[str, Sequence[float]]] = ...,
        table_normal: Sequence[float] = ...,
    ) -> Machine: ...
    @property
    def chain(self) -> str: ...
    @property
    def letters(self) -> str: ...
    @property
    def sides(self) -> list[Literal["table", "head"]]: ...
    @property
    def roles(self) -> tuple[str | None, str | None]:
        """Letters of the axis that turns the work against the tool and of the one that tilts it."""

    @property
    def level_deg(self) -> float:
        """Position of the tilting axis at which the table top looks to the spindle."""

    @property
    def location_errors(self) -> list[tuple[str, str]]: ...
    @property
    def redundant_errors(self) -> list[tuple[str, str]]:
        """Components of axes that are no location errors, and why."""

    def forward(self, axes: _Floats) -> _Floats: ...
    def apart(self, axes: _Floats, points_mm: _Floats) -> _Floats:
        """Points less tool points, along X, Y and Z of the machine, µm."""

    def jacobian(self, axes: _Floats) -> _Floats: ...
    def inverse(self, tools: _Floats, reference_deg: _Floats) -> tuple[_Floats, _Flags]: ...
    def inverse_exact(self, tools: _Floats, starts: _Floats) -> _Floats: ...
    def linear_axes_for(self, points: _Floats, rotary_deg: _Floats) -> _Floats: ...
    def table_pose(self, rotary_deg: _Floats) -> _Floats: ...

class _Plan(TypedDict):
    rotary_deg: _Floats
    sense: _Floats
    contact_mm: _Floats
    start_mm: _Floats
    direction: _Floats
    cycle: _Integers
    point: _Integers
    feed_mm_min: _Floats

@final
class Arrangement:
    """Machine, artefact on its table, probe, and the measures of an approach."""

    def __new__(
        cls,
        machine: Machine,
        artefact: Artefact,
        *,
        ball_radius_mm: float,
        stem_radius_mm: float,
        stem_length_mm: float,
        body_radius_mm: float,
        body_length_mm: float,
        table_radius_mm: float,
        table_thickness_mm: float,
        clearance_mm: float,
        overtravel_mm: float,
        rotary_offset_deg: float,
    ) -> Arrangement: ...
    def plan(
        self,
        *,
        turn_deg: Sequence[float],
        tilt_deg: Sequence[float],
        pairs_deg: Sequence[tuple[float, float]],
        feeds_mm_min: Sequence[float],
        both_senses: bool,
        repeats: int,
        linear_um: float,
        rotary_arcsec: float,
        layout: str,
        all_faces: bool,
    ) -> _Plan:
        """Plan touches; see :func:`trunnion.plan`."""

    def safe_levels(
        self, rotary_deg: _Floats
    ) -> tuple[float, np.ndarray[tuple[int], np.dtype[np.float64]]]:
        """Z above all that swings, and above everything at each row's posture, mm."""

    def offset_shift_mm(self, distance_mm: float) -> float:
        """How far offsets of the rotary axes move a point so far from the table's top, mm."""

    def blocked_moves(self, moves: Moves, reach_mm: Sequence[float]) -> list[int]:
        """Rows of moves from their starts that ball and stem cannot make."""

@final
class Moves:
    """Touches or planned moves, converted once to the core's units."""

    def __new__(
        cls,
        rotary_deg: _Floats,
        point_mm: _Floats,
        direction: _Floats,
        feed_mm_min: _Floats | None = None,
        time_s: _Floats | None = None,
        sense: _Floats | None = None,
    ) -> Moves: ...
    def turned(self, axis: int, by_deg: float) -> Moves:
        """The same rows with one rotary axis further by an angle, in the machine's sense."""

    def __len__(self) -> int: ...

class _Fit(TypedDict):
    values: _Floats
    std_errors: _Floats
    covariance: _Floats
    residuals_um: _Floats
    sigma_um: float
    null_space: _Floats
    singular_values: _Floats
    weights: _Floats
    degrees_of_freedom: int
    converged: bool
    steps: int

@final
class TouchModel:
    """Location errors, placement and effects as parameters, in this order, in user units."""

    def __new__(
        cls,
        machine: Machine,
        artefact: Artefact,
        *,
        ball_radius_mm: float,
        tick_um: float,
        servo_period_ms: float,
        effect_ids: Sequence[str],
    ) -> TouchModel: ...
    @property
    def letters(self) -> str: ...
    @property
    def parameters(self) -> list[tuple[str, str, _Kind]]: ...
    @property
    def unknown(self) -> list[bool]: ...
    @property
    def error_count(self) -> int: ...
    def residuals(self, moves: Moves, values: _Floats) -> _Floats: ...
    def linearise(self, moves: Moves, values: _Floats) -> tuple[_Floats, _Floats]: ...
    def rates(self, moves: Moves, values: _Floats, columns: Sequence[int]) -> _Floats:
        """Derivative by some parameters at each of some values (v, p), (v k, n)."""

    def faces(self, moves: Moves) -> list[str]: ...
    def simulate(
        self,
        moves: Moves,
        values: _Floats,
        *,
        from_start: bool,
        reach_mm: float,
        noise_um: float,
        seed: int,
        sample: int,
    ) -> _Floats: ...
    def fit(
        self,
        moves: Moves,
        start: _Floats,
        *,
        huber: float | None,
        sigma_um: float,
        priors: Sequence[tuple[int, float, float]],
        max_steps: int,
    ) -> _Fit: ...
    def fit_many(
        self,
        moves: Moves,
        points: _Floats,
        start: _Floats,
        *,
        huber: float | None,
        sigma_um: float,
        priors: Sequence[tuple[int, float, float]],
        max_steps: int,
        threads: int | None,
    ) -> tuple[_Floats, _Floats, _Flags]: ...
    def separate(
        self, moves: Moves, labels: Sequence[int], start: _Floats
    ) -> tuple[_Floats, float, float, _Floats]: ...
    def printed(
        self, moves: Moves, labels: Sequence[int]
    ) -> tuple[_Floats, _Floats, _Floats, _Floats]: ...

@final
class Measurements:
    """Virtual measurements of one plan by one probe; rows of samples, and those that failed."""

    def __new__(
        cls,
        model: TouchModel,
        moves: Moves,
        labels: Sequence[int],
        *,
        reach_mm: float,
        noise_um: float,
        seed: int,
    ) -> Measurements: ...
    def calibrations(
        self, truths: _Floats, *, first_sample: int, identify: bool, threads: int | None
    ) -> tuple[_Floats, list[tuple[int, str]]]: ...
    def compensations(
        self,
        truths: _Floats,
        *,
        first_sample: int,
        method: _Method,
        grid: Sequence[Sequence[float]],
        rotary_deg: Sequence[float],
        threads: int | None,
    ) -> tuple[_Floats, list[tuple[int, str]]]: ...

__all__ += ["MachineModel", "field_at", "field_on_grid", "field_statistics"]

@final
class MachineModel:
    """A machine with location errors, placement of the work and effects of the machine.

    Fields are affine in the point of the work: twelve numbers a pose, gain (µm per mm) and offset
    (µm), row by row.
    """

    def __new__(
        cls,
        machine: Machine,
        *,
        errors: Sequence[tuple[str, float]],
        placement: Sequence[float],
        effects: Sequence[tuple[str, Sequence[float]]],
        direction: Sequence[float],
        sense: Sequence[float],
    ) -> MachineModel: ...
    @property
    def letters(self) -> str: ...
    @property
    def parameters(self) -> list[tuple[str, str]]: ...
    @property
    def control_parameters(self) -> list[str]: ...
    def fields(
        self, control: MachineModel, zeros_arcsec: Sequence[float], rotary_deg: _Floats
    ) -> tuple[_Floats, _Floats]: ...
    def truth_rates(
        self, control: MachineModel, zeros_arcsec: Sequence[float], rotary_deg: _Floats
    ) -> _Floats: ...
    def control_rates(
        self, control: MachineModel, zeros_arcsec: Sequence[float], rotary_deg: _Floats
    ) -> _Floats: ...
    def linear_commands(
        self, points_mm: _Floats, rotary_deg: _Floats, threads: int | None
    ) -> _Floats: ...
    def commands(
        self,
        points_mm: _Floats,
        rotary_deg: _Floats,
        largest_turn_deg: float,
        threads: int | None,
    ) -> tuple[_Floats, _Floats, _Flags]: ...
    def reached(self, axes_mm_deg: _Floats, threads: int | None) -> _Floats: ...

def field_statistics(fields: _Floats, grid: Sequence[Sequence[float]]) -> tuple[_Floats, _Floats]:
    """Largest length in the box and mean square over the grid, of each field (m, 12)."""

def field_at(field: _Floats, points_mm: _Floats, threads: int | None) -> _Floats: ...
def field_on_grid(
    field: _Floats, grid: Sequence[Sequence[float]], threads: int | None
) -> _Floats: ...

# --- turning, part programs
__all__ += [
    "Program",
    "TurnedProbePath",
    "TurnedProfile",
    "turning_cause",
    "turning_change",
    "turning_correct",
]

@final
class Program:
    """A part program: blocks of words and comments in the spelling of a dialect."""

    @staticmethod
    def parse(text: str, dialect: str) -> Program: ...
    @staticmethod
    def from_blocks(
        dialect: str, blocks: Sequence[str | Sequence[tuple[str, float]]]
    ) -> Program: ...
    @property
    def dialect(self) -> str: ...
    def text(self) -> str: ...
    def words(self, block: int) -> list[tuple[str, float, int, int]]: ...
    def comments(self) -> list[tuple[int, str]]: ...
    def contour_blocks(self) -> tuple[int, int] | None: ...
    def path(
        self,
        *,
        blocks: tuple[int, int] | None = None,
        start: Sequence[float] | None = None,
        feed: float | None = None,
        machine_codes: Sequence[tuple[str, float]] = ...,
    ) -> dict[str, npt.NDArray[Any]]: ...
    def __len__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class TurnedProfile:
    """A turned contour of lines and arcs."""

    @staticmethod
    def from_vertices(vertices: Sequence[tuple[float, float, str, float]]) -> TurnedProfile: ...
    @staticmethod
    def from_program(
        program: Program,
        *,
        follows: str,
        nose_mm: float,
        position: Sequence[float] | None = None,
        feed: float | None = None,
        machine_codes: Sequence[tuple[str, float]] = ...,
    ) -> TurnedProfile: ...
    @staticmethod
    def from_elements(
        elements: npt.NDArray[Any], reliefs: Sequence[tuple[float, float, float]]
    ) -> TurnedProfile: ...
    def elements(self) -> npt.NDArray[Any]: ...
    def path(self, follows: str, nose_mm: float, convex: str) -> npt.NDArray[Any]: ...
    def reliefs(self) -> list[tuple[float, float, float]]: ...
    def radius_at(self, z_mm: float) -> float | None: ...
    def finishing(
        self,
        *,
        dialect: str,
        follows: str,
        nose_mm: float,
        convex: str,
        first_element: int,
        start_z_mm: float,
        retract_x_mm: float,
        approach_mm: float,
        steepest_fall: float,
        access_z_mm: Sequence[float],
        feed: float | None,
        first_number: int | None,
        head: Sequence[Sequence[tuple[str, float]]],
        tail: Sequence[Sequence[tuple[str, float]]],
    ) -> tuple[Program, list[tuple[float, float]]]: ...
    def probe_path(
        self,
        *,
        ball_radius_mm: float,
        contact_angle_deg: float,
        body_diameter_mm: float,
        allowance_mm: float,
        skip: Sequence[int],
        retract_x_mm: float,
        approach_mm: float,
        chuck_radius_mm: float,
        chuck_face_mm: float,
        shortest_mm: float,
    ) -> TurnedProbePath: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class TurnedProbePath:
    """The path of the probe along a part."""

    def intervals(self) -> npt.NDArray[Any]: ...
    def moves(self) -> npt.NDArray[Any]: ...
    def left_out(self) -> list[tuple[int, str]]: ...
    def contact_z(
        self, interval: int, z_mm: npt.NDArray[Any], ball_radius_mm: float
    ) -> npt.NDArray[Any]: ...
    def program(
        self,
        *,
        dialect: str,
        feed: float | None,
        first_number: int | None,
        comments: Sequence[str],
        head: Sequence[Sequence[tuple[str, float]]],
        tail: Sequence[Sequence[tuple[str, float]]],
        retract_last: bool,
    ) -> Program: ...

def turning_correct(
    program: Program,
    z_mm: npt.NDArray[Any],
    error_um: npt.NDArray[Any],
    *,
    unit_um: float,
    window: int,
    rule: str,
    bound_um: float,
    look_ahead: bool,
    follows: str,
    nose_mm: float,
    position: Sequence[float] | None,
    feed: float | None,
    machine_codes: Sequence[tuple[str, float]],
    keep_numbers: bool,
) -> dict[str, Any]: ...
def turning_change(
    before: Program,
    after: Program,
    z_mm: npt.NDArray[Any],
    *,
    follows: str,
    nose_mm: float,
    position: Sequence[float] | None,
    feed: float | None,
    machine_codes: Sequence[tuple[str, float]],
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]: ...
def turning_cause(
    cause: str, cuts: npt.NDArray[Any], overhang_mm: float, parameters: Sequence[float]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]: ...

# --- contouring
__all__ += [
    "ContourPath",
    "contour_axis_margins",
    "contour_axis_response",
    "contour_axis_responses",
    "contour_path_margins",
    "contour_simulate",
    "contour_sweep",
]

@final
class ContourPath:
    def __new__(
        cls,
        breaks: _Floats,
        coefficients: _Floats,
        omega: _Floats,
        cosine: _Floats,
        sine: _Floats,
    ) -> ContourPath: ...
    @property
    def length_mm(self) -> float: ...
    def frames(self, u: _Floats) -> tuple[_Floats, _Floats, _Floats]: ...
    def at_length(self, s_mm: _Floats) -> _Floats: ...

def contour_simulate(
    path: ContourPath,
    feed: _Feed,
    *,
    period_s: float,
    axes: _Floats,
    feedback: _Feedback,
    coupling: _Coupling | None,
    assumed: Machine,
    real: Machine,
) -> dict[str, bool | _Floats]: ...
def contour_sweep(
    paths: Sequence[ContourPath],
    *,
    path_index: Sequence[int],
    feeds: Sequence[_Feed],
    period_s: float,
    axes: _Floats,
    feedback: _Feedback,
    couplings: Sequence[_Coupling | None],
    coupling_index: Sequence[int],
    assumed: Machine,
    real: Machine,
) -> tuple[list[str], _Floats]: ...
def contour_axis_margins(
    axes: _Floats,
    gains_of_coupling: _Floats | None,
    period_s: float,
) -> _Floats: ...
def contour_axis_response(
    letter: str,
    axis: _Floats,
    period_s: float,
    feedback: _Feedback,
    command: _Floats,
) -> _Floats: ...
def contour_axis_responses(
    letter: str,
    axes: _Floats,
    period_s: float,
    feedback: _Feedback,
    command: _Floats,
    *,
    stride: int,
    starts: _Floats | None = None,
) -> _Floats: ...
def contour_path_margins(
    path: ContourPath,
    u: _Floats,
    *,
    axes: _Floats,
    gains: _Floats,
    period_s: float,
    assumed: Machine,
) -> _Floats: ...

# --- hybrid
__all__ += ["Hybrid", "hybrid_example", "hybrid_parameter", "hybrid_parameters"]

def hybrid_parameters() -> tuple[list[str], list[str]]:
    """Names with units: the 17, and every component at every place."""

def hybrid_parameter(name: str) -> str:
    """The name with unit that a spelling stands for."""

def hybrid_example() -> list[float]:
    """Nominal e1 to e17 of the example, mm and rad."""

@final
class Hybrid:
    """A hybrid mechanism: errors in µm and arcsec, closure weights in mm, joints in mm and deg."""

    def __new__(
        cls,
        dimensions: Sequence[float],
        home_mm: Sequence[float],
        errors: Sequence[tuple[str, float]],
        closure_mm: Sequence[float],
    ) -> Hybrid: ...
    @property
    def home_legs_mm(self) -> list[float]: ...
    def forward(self, joints: _Floats, threads: int | None) -> _Floats: ...
    def sensitivity(
        self, joints: _Floats, names: Sequence[str], threads: int | None
    ) -> _Floats: ...
    def strain(self, joints: _Floats, names: Sequence[str], threads: int | None) -> _Floats: ...
    def ballbar(
        self, joints: _Floats, centres: _Floats, names: Sequence[str], threads: int | None
    ) -> _Floats: ...
    def inverse(
        self,
        tips: _Floats,
        directions: _Floats,
        *,
        reference_deg: float,
        negative: bool,
        exact: bool,
        threads: int | None,
    ) -> _Floats: ...
    def constraint(self, joints: Sequence[float]) -> tuple[int, list[float], _Floats, _Floats]: ...
