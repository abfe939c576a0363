"""Render the conda recipe as conda-forge would, for each platform: `make recipe`.

rattler-build is installed into target/recipe. Nothing is built: that needs the release on PyPI and
conda-forge's packages.
"""

from __future__ import annotations

import sys

import audit

PLATFORMS = ("linux-64", "linux-aarch64", "osx-arm64", "win-64")
RENDER = """
import sys
import rattler_build as rattler
recipe = rattler.Stage0Recipe.from_file(sys.argv[1])
for name in sys.argv[2:]:
    platform = rattler.PlatformConfig(target_platform=name)
    (made,) = recipe.render(rattler.VariantConfig(), rattler.RenderConfig(platform=platform))
    needs = made.recipe.to_dict()["requirements"]
    print(f"{name}: {', '.join(needs['build'])} to build, {len(needs['run'])} packages to run")
"""


def main() -> None:
    """Render it, and say what each platform needs."""
    place = audit.ROOT / "target" / "recipe"
    place.mkdir(parents=True, exist_ok=True)
    try:
        python = audit.tools(place, audit.CONFIG["tools"]["recipe"]) / "python"
    except audit.NotAskedError as why:
        sys.exit(f"the conda recipe was not rendered: {why}")
    done = audit.run([python, "-c", RENDER, audit.ROOT / "conda" / "recipe.yaml", *PLATFORMS])
    print(done.stdout, end="")
    if done.returncode:
        sys.exit(done.stderr)


if __name__ == "__main__":
    main()
