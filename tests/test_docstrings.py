"""Every public name has an example in its docstring, which runs and prints what it says."""

import doctest
import inspect
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

import trunnion as tn

NAMES = [name for name in vars(tn)["__all__"] if callable(getattr(tn, name))]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of other packages
def test_the_example(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(tn, name)) or ""
    test = doctest.DocTestParser().get_doctest(text, {}, name, name, 0)
    assert test.examples, f"{name} has no example in its docstring"
    said: list[str] = []
    failed = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append).failed
    assert not failed, "".join(said)
    plt.close("all")
