import trunnion as tn


def test_package_has_a_version() -> None:
    assert tn.__version__.count(".") == 2
