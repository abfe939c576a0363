# One target, one habit. Every target sets up what it needs: a virtual environment in .venv with
# the versions of requirements.lock, and the extension module built in release mode.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
RUST_SOURCES := $(shell find rust -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock

.PHONY: help
help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# Steps that print a screen of lines nobody reads say what they do, how long it took, and the lines
# only if they fail. Nothing here minds a path with spaces, or running in the background.
STEP := sh tools/step.sh

.venv/.installed: requirements.lock
	@$(STEP) "Virtual environment .venv" $(PYTHON) -m venv .venv
	@$(STEP) "Packages of requirements.lock into .venv (minutes the first time)" \
		$(BIN)/python -m pip install --disable-pip-version-check -r requirements.lock
	@touch $@

.venv/.built: .venv/.installed pyproject.toml $(RUST_SOURCES)
	@$(STEP) "Extension module, release mode (minutes the first time)" \
		$(BIN)/python -m maturin develop --release --quiet
	@touch $@

.PHONY: build
build: .venv/.built  ## virtual environment and extension module, release mode

.PHONY: demo
demo: build  ## the main job: Table 2 of the paper, and a measurement that comes with the package
	@$(BIN)/python -m trunnion demo

.PHONY: test
test: build  ## everything: cargo tests, then pytest with the notebooks; a quarter of an hour on two cores
	@$(STEP) "Tests of the core (cargo)" cargo test --workspace --quiet
	@echo "Tests of the package (pytest, every core): a quarter of an hour on two cores ..."
	@$(BIN)/python -m pytest -q

.PHONY: fuzz
fuzz: build  ## hostile arguments, a million mutated files, 10,000 diagnosed, an hour and a half, into docs/results/fuzz.md
	cd tests && ../$(BIN)/python -W error fuzz.py --out ../docs/results/fuzz.md

.PHONY: bench
bench: build  ## medians and ratios of the main job beside peers in the same run
	$(BIN)/python tests/benches/bench_main.py

.PHONY: bench-joint
bench-joint: build  ## what a joint diagnosis costs beside its measurements one by one, two minutes
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -W ignore tests/benches/bench_joint.py

.PHONY: bench-rows
bench-rows: build  ## seconds and memory of a diagnosis of 10⁵ rows of each kind, three minutes
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benches/bench_rows.py

.PHONY: sweep-size
sweep-size: build  ## what a sweep costs by its size, 10⁴ to 10⁷ samples, ten minutes, into docs/results/sweep-size.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/sweep_size.py --out docs/results/sweep-size.md

.PHONY: power
power: build  ## how often a diagnosis is right: each rate held, half an hour, and docs/results/power.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m power
	cd tests && OMP_NUM_THREADS=1 ../$(BIN)/python -m power --out ../docs/results/power.md
	cd tests && OMP_NUM_THREADS=1 ../$(BIN)/python -m power.measured_table --runs 60 --out ../docs/results/power-measured.md

.PHONY: collisions
collisions: build  ## every move of the programs and plans of 800 random machines swept for obstacles, ten minutes
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -s -n 0 -m power tests/test_keeps_clear.py

.PHONY: power-probabilities
power-probabilities: build  ## are stated probabilities true: 10,800 cases of all kinds, an hour, into docs/results/power-probabilities.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.probabilities --out ../docs/results/power-probabilities.md

.PHONY: power-further
power-further: build  ## does the further test that is advised settle the doubt, ten minutes, into docs/results/power-further.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.further --out ../docs/results/power-further.md

.PHONY: power-joint
power-joint: build  ## is a joint diagnosis of several measurements right, half an hour, into docs/results/power-joint.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.joint --out ../docs/results/power-joint.md

.PHONY: power-ballbar
power-ballbar: build  ## the same for ball-bar tests of hybrid and three-axis machines, ten minutes
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/ballbar_study.py --out docs/results/power-ballbar.md

.PHONY: power-coverage
power-coverage: build  ## do uncertainties of location errors hold: 2,000 cases, half an hour, into docs/results/power-coverage.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.coverage --plan paper --seed 31 --out ../docs/results/power-coverage.md

.PHONY: power-warming
power-warming: build  ## the same beside warm-ups of shapes that the catalogue does not have, ten minutes, into docs/results/power-warming.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.warming --runs 12 --seed 31 --out ../docs/results/power-warming.md

.PHONY: power-curves
power-curves: build  ## do they hold beside curves of a guide, and are short waves on a plate seen: two minutes, printed
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.curves

.PHONY: power-ticks
power-ticks: build  ## the same for readings on a servo's grid, half an hour, into docs/results/power-ticks.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.ticks --out ../docs/results/power-ticks.md

.PHONY: power-steps
power-steps: build  ## is a sound machine found sound by repeats in steps, ten minutes, into docs/results/power-steps.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.steps --out ../docs/results/power-steps.md

.PHONY: power-positioning
power-positioning: build  ## the same for positioning and levels, by other formulas, two minutes, into docs/results/power-positioning.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.positioning --out ../docs/results/power-positioning.md

.PHONY: power-axis-logs
power-axis-logs: build  ## the same for logs of axis positions, half an hour, into docs/results/power-axis-logs.md
	cd tests && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 ../$(BIN)/python -m power.axis_logs --runs 30 --seed 2 --out ../docs/results/power-axis-logs.md

.PHONY: lint
lint: build  ## rustfmt, clippy, ruff, mypy --strict, stubtest
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff check python tests docs tools
	$(BIN)/ruff format --check python tests docs tools
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest trunnion._core

.PHONY: format
format: .venv/.installed  ## format with rustfmt and ruff
	cargo fmt --all
	$(BIN)/ruff check --fix python tests docs tools
	$(BIN)/ruff format python tests docs tools

.PHONY: lock
lock: .venv/.installed  ## renew requirements.lock from pyproject.toml
	@$(STEP) "pip-tools" $(BIN)/python -m pip install pip-tools
	@$(STEP) "requirements.lock" $(BIN)/python -m piptools compile --quiet --strip-extras --no-emit-find-links \
		--no-emit-index-url --no-emit-trusted-host --no-header --all-extras --unsafe-package trunnion \
		--resolver=backtracking --output-file requirements.lock pyproject.toml

.PHONY: wheels
wheels: build  ## wheel (manylinux, every Python from 3.11) and source distribution, tried in fresh environments
	@$(BIN)/python tools/wheels.py

.PHONY: tutorials
tutorials: build  ## every tutorial in a fresh environment, its pip lines too, as a new user follows it, five minutes
	@$(BIN)/python tools/tutorials.py

.PHONY: sbom
sbom: build  ## what a wheel is made of: dist/sbom.json (CycloneDX), and a check of all licences
	@$(BIN)/python tools/bom.py

.PHONY: audit
audit: build  ## licences, advisories and withdrawn releases of all dependencies, a minute, into dist/audit.json
	@$(BIN)/python tools/audit.py

.PHONY: recipe
recipe: build  ## the conda recipe rendered for each platform (rattler-build), nothing built
	@$(BIN)/python tools/recipe.py

.PHONY: release
release: build  ## what is left to do for a release; changes nothing (tools/release.py --do does)
	@$(BIN)/python tools/release.py

.PHONY: power-turning
power-turning: build  ## the same for diameters of turned passes, ten minutes, into docs/results/power-turning.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/turning_blind.py 200 --out docs/results/power-turning.md

.PHONY: linuxcnc
linuxcnc: build  ## 200 machines with hidden errors probed in a real LinuxCNC, and from wrong states, two hours, into docs/results/linuxcnc-*.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/probing_bench.py 200 --out docs/results/linuxcnc-runs.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/states_bench.py 200 --out docs/results/linuxcnc-states.md

.PHONY: linuxcnc-corrected
linuxcnc-corrected: build  ## 20 hidden machines corrected in a real LinuxCNC, twenty minutes, into docs/results/linuxcnc-corrected.md
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/corrected_bench.py 20 --out docs/results/linuxcnc-corrected.md

# LinuxCNC's interpreter, which the tests of part programs run where it is there: the two packages it
# needs beyond a usual Debian, unpacked and not installed (installing pulls in a desktop).
RS274 := target/rs274/usr/bin/rs274

.PHONY: rs274
rs274: $(RS274)  ## LinuxCNC's G-code interpreter for the tests (Debian; unpacked below target)

$(RS274):
	mkdir -p target/rs274
	cd target/rs274 && packages="linuxcnc-uspace $$(apt-cache depends linuxcnc-uspace \
		| sed -n 's/^ *Depends: \(libboost-python[0-9.]*\)$$/\1/p')" \
		&& apt-get download $$packages && for deb in *.deb; do dpkg -x "$$deb" . && rm "$$deb"; done

.PHONY: clean
clean:  ## remove everything that was built
	rm -rf .venv target

.PHONY: real-machines
real-machines: build  ## docs/results/real-machines.md with figures, from the measured files of others
	$(BIN)/python docs/make_real_machines.py

.PHONY: docs
docs: build  ## figures and generated tables of README and docs, from real runs
	$(BIN)/python docs/make_effects_table.py
	$(BIN)/python docs/make_files_tables.py
	$(BIN)/python docs/make_papers.py
	$(BIN)/python docs/make_artefacts.py
	$(BIN)/python docs/make_figures.py
	$(BIN)/python docs/make_drawings.py
	$(BIN)/python docs/make_effect_pictures.py
	$(BIN)/python docs/make_report_picture.py
	$(BIN)/python docs/make_measured_figures.py

.PHONY: notebooks
notebooks: build  ## run the notebooks and keep what they show, five minutes
	$(BIN)/python docs/make_notebooks.py

.PHONY: site
site: build  ## the documentation site, into target/site, without a network; warnings are errors
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	@echo "target/site/index.html; to search in it: $(BIN)/python -m http.server -d target/site"
