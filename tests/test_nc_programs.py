"""Part programs: parse is the inverse of emit, and faults have their place."""

import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunnion import InputError, ProgramError, UnknownNameError
from trunnion.nc import DIALECTS, Program, follow
from trunnion.turning import Profile

NUMBER = st.from_regex(r"[-+]?([0-9]{1,6}(\.[0-9]{0,5})?|\.[0-9]{1,5})", fullmatch=True)
PRINTABLE = st.characters(codec="ascii", exclude_characters="()\r\n", min_codepoint=32)
COMMENT = st.text(alphabet=PRINTABLE, max_size=12)


@st.composite
def block(draw: st.DrawFn) -> str:
    letters = draw(st.lists(st.sampled_from("GMXYZABCIJKRFSTPQDH"), max_size=6, unique=True))
    words = [letter + draw(NUMBER) for letter in letters]
    if draw(st.booleans()):
        words.insert(0, "N" + str(draw(st.integers(0, 9999))))
    if draw(st.booleans()):
        words.insert(draw(st.integers(0, len(words))) if words else 0, f"({draw(COMMENT)})")
    skip = "/" if draw(st.booleans()) else ""
    if words and words[0].startswith("("):
        words = [w for w in words if not w.startswith("N")]
    return skip + draw(st.sampled_from(["", " "])).join(words)


@given(st.lists(block(), max_size=8), st.sampled_from(DIALECTS))
@settings(max_examples=50, deadline=None)
def test_parse_is_the_inverse_of_emit(lines: list[str], dialect: str) -> None:
    program = Program.parse("\n".join(lines), dialect)
    again = Program.parse(program.text(), dialect)
    assert again == program
    assert again.text() == program.text()
    assert pickle.loads(pickle.dumps(program)) == program
    # No word is lost and none is made.
    for i, line in enumerate(lines[: len(program)]):
        plain = line
        for _, comment in program.comments():
            plain = plain.replace(f"({comment})", "")
        assert len(program.words(i)) == sum(c.isalpha() for c in plain)


BAD = [
    ("G0 X40 Z0\nG1 Z-10", "linuxcnc-lathe", "line 2, column 4: a feed move but no feed"),
    ("G0 X40 Z0\nG2 X50 Z-5 F1", "linuxcnc-lathe", "line 2, column 4: an arc without radius"),
    ("G0 X40 Z0\nG2 X50 Z-5 K-3 F1", "linuxcnc-lathe", "line 2, column 4: the arc does not close"),
    ("G0 X40 Z0\nG2 X90 Z-5 R5 F1", "linuxcnc-lathe", "line 2, column 12: radius 5 mm"),
    ("G0 X40 Z0 E3", "linuxcnc-lathe", "line 1, column 11: E3 has no meaning"),
    ("G0 X40 Z0\nG123", "fanuc-lathe", "line 2, column 1: G123 is not known"),
    ("G0 X40. Z0\nM98 P10", "fanuc-lathe", "line 2, column 1: subprograms"),
    ("G0 X40. Z0\nG1 Z-9. F1", "fanuc-lathe", "line 2, column 9: feed per revolution without"),
    ("G0 X40 Z#1", "linuxcnc-lathe", "line 1, column 8: Z without a number: got '#'"),
    ("(open", "linuxcnc", "line 1, column 1: comment without"),
]


@pytest.mark.parametrize(("text", "dialect", "message"), BAD)
def test_bad_programs_are_told_with_line_and_column(text: str, dialect: str, message: str) -> None:
    with pytest.raises(ProgramError) as caught:
        follow(Program.parse(text, dialect))
    assert str(caught.value).startswith(message)


def test_a_profile_that_folds_back_is_told_with_its_place() -> None:
    program = Program.parse("G7 G0 X40 Z0\nG1 Z-10 F1\nX50 Z-5\nZ-30", "linuxcnc-lathe")
    with pytest.raises(ProgramError, match="line 3, column 1: the contour folds back"):
        Profile.from_program(program)


def test_machine_codes_are_passed_over_when_told() -> None:
    program = Program.parse("G4503\nG0X40.Z0\nG1Z-9.F.1", "fanuc-lathe")
    with pytest.raises(ProgramError, match="G4503"):
        follow(program)
    assert len(follow(program, machine_codes=[("G", 4503)])) == 1


def test_profile_to_program_and_back() -> None:
    text = "G7 G0 X40 Z60\nG1 Z40 F1\nG2 X50 Z35 R5\nG1 X60 Z20\nZ0"
    contour = Profile.from_program(Program.parse(text, "linuxcnc-lathe"))
    for follows in ("contour", "nose-centre", "tip"):
        for dialect in ("linuxcnc-lathe", "fanuc-lathe", "paper-um"):
            head = [[("G", 7)]] if dialect == "linuxcnc-lathe" else []
            made = contour.finishing(dialect, follows=follows, nose_mm=0.8, feed=0.1, head=head)
            back = Profile.from_program(made.program, follows=follows, nose_mm=0.8)
            ends = [e for e in back.elements if abs(e[1] - e[3]) > 1e-6 or e[0] != 0]
            assert abs(ends[-1][4] - 30.0) < 1e-3
            assert abs(back.radius_mm(50.0) - 20.0) < 1e-3  # type: ignore[operator]
            assert abs(back.radius_mm(37.0) - contour.radius_mm(37.0)) < 2e-3  # type: ignore[operator]


def test_unknown_names() -> None:
    with pytest.raises(UnknownNameError, match="dialect"):
        Program.parse("", "heidenhain")
    with pytest.raises(InputError, match="comment"):
        Program.from_blocks("linuxcnc", ["a (b)"])
