# Needed beforehand: python3 (3.11 or newer) with venv and headers, a C compiler. Everything else goes into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
BUILD_REQUIREMENTS = $(BIN)/python -c 'import tomllib; \
	print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")'

.PHONY: help env demo gallery docs tables report stability benchmarks cost faults test test-all test-lowest test-pythons wheel lint bench bench-save bench-compare bench-peers clean
.NOTPARALLEL:

help:
	@echo "make demo         the BRDF of a gold powder: out/gold_powder.nc, .csv and .png"
	@echo "make gallery      powders and paints as objects under a polarized sky, with their lobes: out/gallery"
	@echo "make docs         the documentation site: out/site"
	@echo "make test         style, types and the quick tests"
	@echo "make test-all     style, types and every test"
	@echo "make test-lowest  tests of what others' packages do, with the oldest of them that pyproject.toml allows: .venv-lowest"
	@echo "make test-pythons  built and used with each CPython 3.11 to 3.14 that is found, newest dependencies: out/pythons"
	@echo "make lint         style and types only"
	@echo "make wheel        the source archive, and a wheel of it for this Python and system: dist"
	@echo "make tables       the GPU paper's tables and figure 1, measured here: out/tables"
	@echo "make cost         figures 2 to 9 of the same paper, how the cost grows: out/cost"
	@echo "make stability    stiff and extreme scenes, solved and checked: out/stability; taken up again where it stopped"
	@echo "make benchmarks   ten scenes with surfaces to ten digits, computed again"
	@echo "make report       error against run time of every method: out/report; taken up again where it stopped"
	@echo "make faults       plants faults in a copy of the source, one at a time, and counts those that the quick tests catch"
	@echo "make bench        the timings of bench/"
	@echo "make bench-save   the timings against the LAPACK floor, kept in bench/history"
	@echo "make bench-compare  the same, beside the last ones kept: fails where a case takes 1.3 times as much"
	@echo "make bench-peers  vrte beside nanodisort and sasktran2: the page docs/reference/peers.md, printed"
	@echo "make env          the environment for development: .venv, editable"
	@echo "make clean        removes what was built and written, not .venv"

# The package itself, editable, with its compiled core; built again when one of these files changes.
$(VENV)/core.stamp: pyproject.toml setup.py vrte/_core.pyx $(wildcard vrte/core/*.* vrte/core/kernels/*) .ci/prerequisites
	@sh .ci/prerequisites $(PYTHON)
	@echo "Making $(VENV) and building the package: about two minutes the first time"
	@$(PYTHON) -m venv $(VENV)
	@$(BUILD_REQUIREMENTS) >$(VENV)/build-requirements.txt
	@$(PIP) install -r $(VENV)/build-requirements.txt
	@$(PIP) install --no-build-isolation --editable .
	@touch $@

# The package is there already, so these add the dependencies of its extras and nothing else.
$(VENV)/demo.stamp: $(VENV)/core.stamp
	@echo "Installing what the demo needs"
	@$(PIP) install 'vrte[files,plot]'
	@touch $@

$(VENV)/gallery.stamp: $(VENV)/core.stamp
	@echo "Installing what the gallery needs"
	@$(PIP) install 'vrte[render]'
	@touch $@

$(VENV)/docs.stamp: $(VENV)/core.stamp
	@echo "Installing what the documentation site needs"
	@$(PIP) install 'vrte[docs]'
	@touch $@

$(VENV)/tables.stamp: $(VENV)/core.stamp
	@echo "Installing what the tables need"
	@$(PIP) install 'vrte[opencl,plot]'
	@touch $@

$(VENV)/report.stamp: $(VENV)/core.stamp
	@echo "Installing what the report needs"
	@$(PIP) install 'vrte[opencl,report]'
	@touch $@

$(VENV)/test.stamp: $(VENV)/core.stamp
	@echo "Installing what the tests need"
	@$(PIP) install 'vrte[test]'
	@touch $@

$(VENV)/wheel.stamp: $(VENV)/core.stamp
	@echo "Installing what builds and checks wheels"
	@$(PIP) install 'vrte[wheel]'
	@touch $@

$(VENV)/bench.stamp: $(VENV)/core.stamp
	@echo "Installing what the comparison with other codes needs"
	@$(PIP) install 'vrte[bench]'
	@touch $@

env: $(VENV)/test.stamp

demo: $(VENV)/demo.stamp
	@mkdir -p out
	$(BIN)/vrte brdf examples/gold_powder.toml -o out/gold_powder.nc --csv out/gold_powder.csv --plot out/gold_powder.png

# The paper's figure 10 and more, as objects; docs/images has copies.
COLOURED = gold gold_coarse copper hematite
WHITE = rutile alumina mixture_on_black mixture_on_white
PEARLS = white_pearl gold_pearl colour_shifter
GALLERY = vrte/app/gallery
SHEET = --sheet --glare --size 220 --samples 64 -o out/gallery
gallery: $(VENV)/gallery.stamp
	@mkdir -p out/gallery
	$(BIN)/vrte render examples/still_life/*.toml --together --glare --size 330 --samples 96 -o out/gallery/hero.png
	$(BIN)/vrte render $(COLOURED:%=$(GALLERY)/%.toml) --object vase $(SHEET)/gallery_powders.png
	$(BIN)/vrte render $(WHITE:%=$(GALLERY)/%.toml) --object vase $(SHEET)/gallery_white_powders.png
	$(BIN)/vrte render $(GALLERY)/paint_bare.toml $(GALLERY)/paint_smooth.toml examples/satin_paint.toml \
		$(GALLERY)/powder_dry.toml $(GALLERY)/powder_wet.toml --object knot $(SHEET)/gallery_surfaces.png
	$(BIN)/vrte render vrte/paints/silver_metallic.toml examples/metallic_clear_coat.toml $(PEARLS:%=vrte/paints/%.toml) \
		--object vase $(SHEET)/gallery_flakes.png
	$(BIN)/python -m docs.scripts.flake_lobes -o out/gallery
	$(BIN)/vrte render examples/black_lacquer.toml examples/white_gloss.toml --size 240 -o out/gallery/gallery_brewster.png

# warnings are errors, and so are links that lead nowhere; the snippets of the pages are run by the tests
docs: $(VENV)/docs.stamp
	@mkdir -p out
	$(BIN)/python docs/try/make_page.py out/try
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "out/site/index.html is the site; python3 -m http.server -d out/site makes its search work"

tables: $(VENV)/tables.stamp
	@mkdir -p out
	$(BIN)/python -m bench.tables -o out/tables

cost: $(VENV)/tables.stamp
	@mkdir -p out
	$(BIN)/python -m bench.cost -o out/cost

stability: $(VENV)/core.stamp
	@mkdir -p out
	$(BIN)/python -m bench.stability -o out/stability

benchmarks: $(VENV)/core.stamp
	$(BIN)/python -m bench.benchmarks

report: $(VENV)/report.stamp
	@mkdir -p out
	$(BIN)/python -m bench.methods -o out/report
	$(BIN)/python -m docs.scripts.radiance_factor -o out/report

# Two at a time, a file to each: many tests wait for processes, browsers and disks. Where no bytecode may be written, each
# process that they start would compile vrte anew, 0.3 s each.
# Two workers on two processors: threads that wait sleep, and BLAS has one, but where a test says otherwise.
test: lint
	env -u PYTHONDONTWRITEBYTECODE OMP_WAIT_POLICY=passive OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q -n 2 --dist loadfile

test-all: lint
	$(BIN)/python -m pytest -q -m "slow or not slow"

# The oldest direct dependencies, in an environment of its own; not the solver's tests, which only know numpy and scipy.
# Old packages warn of what new ones, which they need in turn, are about to drop: those warnings do not count here.
LOWEST := .venv-lowest
ABOUT_DEPENDENCIES = $(patsubst %,tests/test_%.py,against_iadpython appearance_colours base_file cli completion docs foreign_files formats methods_report \
	materials mitsuba opencl_caches opencl_device optics own_tables packaging paint_page phase_matrix pictures reference refused render running scattering_tables scene_file shapes \
	snippets stages) $(wildcard tests/test_app_*.py tests/test_sweep*.py)
test-lowest: $(LOWEST)/stamp
	$(LOWEST)/bin/python -m pytest -q -n 2 --dist loadfile -W ignore::DeprecationWarning -W ignore::FutureWarning \
		$(ABOUT_DEPENDENCIES)

$(LOWEST)/stamp: pyproject.toml setup.py vrte/_core.pyx $(wildcard vrte/core/*.* vrte/core/kernels/*) .ci/prerequisites
	@sh .ci/prerequisites $(PYTHON)
	@echo "Making $(LOWEST) with the oldest packages that are allowed"
	@$(PYTHON) -m venv --clear $(LOWEST)
	@$(LOWEST)/bin/python -m pip --disable-pip-version-check --quiet install uv
	@$(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --editable '.[test]'
	@touch $@

test-pythons: $(VENV)/wheel.stamp
	@sh .ci/test_pythons $(BIN)/python

# Built in isolation, the wheel from the archive. On Linux auditwheel puts libgomp into it and names the oldest C library
# with which it works: that of this machine, about; released wheels are built by cibuildwheel, in images with an old one.
wheel: $(VENV)/wheel.stamp
	@rm -rf dist
	$(BIN)/python -m build --outdir dist .
	$(BIN)/check-wheel-contents dist/*.whl
ifeq ($(shell uname),Linux)
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/auditwheel repair --wheel-dir dist dist/*-linux_*.whl && rm dist/*-linux_*.whl
	$(BIN)/auditwheel show dist/*.whl
endif
	$(BIN)/twine check --strict dist/*

lint: $(VENV)/test.stamp
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo >/dev/null || $(BIN)/lint-imports --no-logo

faults: $(VENV)/test.stamp
	$(BIN)/python -m bench.faults

bench: $(VENV)/test.stamp
	$(BIN)/python -m pytest -q bench

# Cases with a LAPACK floor.
# a target that is missed there is told, and does not keep the ratios from being saved or compared
AGAINST_FLOOR = bench/test_speed.py bench/test_six_configurations.py bench/test_features.py --benchmark-json=out/bench.json

bench-save: $(VENV)/test.stamp
	@mkdir -p out && rm -f out/bench.json
	-$(BIN)/python -m pytest -q $(AGAINST_FLOOR)
	$(BIN)/python -m bench.compare save out/bench.json

# a case that seems too slow is measured once more: one run in three meets a disturbance of the machine
bench-compare: $(VENV)/test.stamp
	@mkdir -p out && rm -f out/bench.json out/again.json
	-$(BIN)/python -m pytest -q $(AGAINST_FLOOR)
	$(BIN)/python -m bench.compare check out/bench.json || { mv out/bench.json out/again.json; \
		$(BIN)/python -m pytest -q $(AGAINST_FLOOR); $(BIN)/python -m bench.compare check out/again.json out/bench.json; }

bench-peers: $(VENV)/bench.stamp
	$(BIN)/python -m bench.peers

clean:
	rm -rf build dist out *.egg-info vrte/_core.c vrte/_core.*.so .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	rm -f $(VENV)/*.stamp
