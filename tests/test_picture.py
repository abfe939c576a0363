"""A picture is described once and drawn by matplotlib and by Plotly."""

import re

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import plotly.graph_objects as go
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from result_examples import EXAMPLES
from trunnion.base.errors import InputError
from trunnion.plot import picture as p
from trunnion.plot.dispatch import thumbnail

mpl.use("agg")


def _picture(kind: p.Kind = p.Kind.CARTESIAN) -> p.Picture:
    x = np.linspace(0, 350, 8)
    wave = np.sin(np.radians(x))
    return p.Picture(
        "A <wave> & 'its' noise",
        p.Axis("C position", "deg"),
        p.Axis("deviation", "µm"),
        (
            p.points(
                x,
                wave,
                "readings",
                hover=tuple(f"line {i}\n<b>" for i in range(8)),
                rows=np.arange(8),
            ),
            p.band(x, wave - 1, wave + 1, "k = 2", colour=p.VERMILLION),
            p.line(x, wave, "fit", dash="dash"),
        ),
        kind,
        notes_at=((90.0, 1.0, "peak"),),
    )


@pytest.mark.parametrize("kind", list(p.Kind))
def test_both_libraries_show_the_same_numbers_and_labels(kind: p.Kind) -> None:
    picture = _picture(kind)
    ax = picture.draw()
    shown = picture.to_plotly()
    go.Figure(shown)  # Plotly checks every name and value
    assert ax.get_title(loc="left") == picture.title
    across, up = ("theta", "r") if kind is p.Kind.POLAR else ("x", "y")
    drawn = ax.lines[0].get_xydata()
    drawn = np.degrees(drawn[:, 0]) if kind is p.Kind.POLAR else drawn[:, 0]
    assert np.allclose(drawn, shown["data"][0][across])
    assert np.allclose(ax.lines[0].get_ydata(), shown["data"][0][up])
    assert [t["name"] for t in shown["data"]] == ["readings", "k = 2", "fit"]
    if kind is not p.Kind.POLAR:
        assert ax.get_xlabel() == shown["layout"]["xaxis"]["title"]["text"] == "C position (deg)"


def test_bars_and_heat_maps() -> None:
    ranked = p.Picture("Shares", p.Axis("share", "%"), p.Axis(names=("a", "b")), (p.bars([3, 1]),))
    go.Figure(ranked.to_plotly())
    assert [t.get_text() for t in ranked.draw().get_yticklabels()] == ["a", "b"]
    names = p.Axis(names=("a", "b"))
    table = p.Picture("Correlation", names, names, (p.heat([[1, -0.5], [-0.5, 1]]),))
    go.Figure(table.to_plotly())
    table.draw()


def test_texts_cannot_become_markup() -> None:
    text = str(_picture().to_plotly())
    assert "<b>" not in text
    assert "line 3<br>&lt;b&gt;" in text


def test_arrows_keep_their_tips() -> None:
    made = p.arrows([0.0, 1.0], [0.0, 0.0], [2.0, 0.0], [0.0, 3.0])
    path = np.stack([made.x, made.y], axis=1).reshape(2, 6, 2)
    assert np.allclose(path[:, 0], [[0, 0], [1, 0]])
    assert np.allclose(path[:, 1], [[2, 0], [1, 3]])
    assert np.isnan(path[:, 5]).all()


def test_a_long_log_is_thinned_to_its_envelope_and_says_so() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(25_000.0)
    y = rng.standard_normal(len(t))
    y[12_345] = 40.0
    whole = p.Picture(
        "Log", p.Axis("time"), p.Axis("error"), (p.points(t, y, rows=np.arange(25_000)),)
    )
    thin = whole.thinned(500)
    s = thin.series[0]
    assert len(s.x) <= 1000
    assert s.y.max() == 40.0
    assert s.y.min() == y.min()
    assert s.rows is not None
    assert np.array_equal(y[s.rows], s.y)
    column = (t * 500 / (t[-1])).astype(int).clip(max=499)
    for c in (0, 250, 499):
        mine = y[column == c]
        assert {mine.min(), mine.max()} <= set(s.y)
    assert "25000 points" in thin.note
    assert whole.series[0].x.size == 25_000
    assert _picture().thinned().note == ""


def test_polar_pictures_need_polar_axes() -> None:
    flat = _picture().draw()
    with pytest.raises(InputError, match="expected polar"):
        _picture(p.Kind.POLAR).draw(flat)


def _luminance(colour: str) -> float:
    parts = [int(c, 16) / 255 for c in re.findall("..", colour[1:])]
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def _contrast(first: str, second: str) -> float:
    high, low = sorted((_luminance(first), _luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(
    "name", ["IdentificationResult", "Iso2302", "Iso2304", "MachineComparison"]
)
def test_a_picture_is_readable_in_a_dark_style(name: str) -> None:
    """Texts at 4.5:1, lines of data at 3:1, on the ground of the style."""
    with plt.style.context("dark_background"):
        drawn = EXAMPLES[name]().plot()
    figure = getattr(drawn, "figure", None) or drawn
    ground = to_hex(figure.get_facecolor())
    assert ground == "#000000"
    texts = [t for t in figure.findobj(Text) if t.get_text().strip() and t.get_visible()]
    assert texts
    assert all(_contrast(to_hex(t.get_color()), ground) >= 4.5 for t in texts)
    lines = [x for ax in figure.axes for x in ax.get_lines()]
    patches = [x for ax in figure.axes for x in ax.patches]
    assert lines or patches
    assert all(_contrast(to_hex(x.get_color()), ground) >= 3.0 for x in lines)
    assert all(_contrast(to_hex(x.get_facecolor()), ground) >= 3.0 for x in patches)
    plt.close("all")


def test_the_small_picture_of_a_page_is_the_same_in_a_dark_style() -> None:
    result = EXAMPLES["Iso2302"]()
    plain = thumbnail(result)
    with plt.style.context("dark_background"):
        assert thumbnail(result) == plain


@pytest.mark.parametrize("colour", [*p.PALETTE, p.MUTED])
def test_colours_are_seen_on_white_and_on_dark(colour: str) -> None:
    for ground in ("#ffffff", "#16181d"):
        assert _contrast(colour, ground) >= 3.0
