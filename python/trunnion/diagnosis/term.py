"""A term: what structure without a name depends on, and how."""

from dataclasses import dataclass
from typing import cast

from trunnion.base.report import rough
from trunnion.diagnosis.ways import in_words

Place = float | tuple[float, float]  # of a jump; of a local error, with its width


@dataclass(frozen=True)
class Term:
    """A function of one covariate that enters through one component.

    ``kind``: "harmonic", "polynomial", "wave", "jump", "local" or "class"; ``number``: its
    harmonic, its degree, its waves over the range, the value at which it jumps, the value about
    which it acts and its width, or the label of its class.
    """

    covariate: str
    kind: str
    number: object
    component: str
    unit: str = ""

    def sentence(self) -> str:
        """Say it in words."""
        where = in_words(self.component)
        u = f" {self.unit}" if self.unit else ""
        match self.kind:
            case "harmonic":
                how = f"{ordinal(int(str(self.number)))} harmonic"
            case "polynomial":
                how = {1: "linear", 2: "quadratic", 3: "cubic"}.get(
                    int(str(self.number)), f"smooth, degree {self.number}"
                )
            case "wave":
                how = f"periodic, period {rough(float(str(self.number)), 4)}{u}"
            case "jump":
                how = f"a jump at {rough(float(str(self.number)), 4)}{u}"
            case "local":
                place, width = self.place_and_width
                how = f"a local error at {rough(place, 4)}{u}, {rough(width, 4)}{u} wide"
            case _:
                at = f"{self.number:g}{u}" if isinstance(self.number, float) else self.number
                return f"{self.covariate} {at} (by itself{where})"
        return f"{self.covariate} ({how}{where})"

    @property
    def place_and_width(self) -> tuple[float, float]:
        """Of a local error."""
        place, width = cast("tuple[float, float]", self.number)
        return place, width


def ordinal(n: int) -> str:
    """Write 1st, 2nd, 3rd, 4th."""
    return f"{n}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(n if n < 20 else n % 10, 'th') }"
