# Every target makes .venv first where it is missing or older than what it is made from.
# POSIX make and shell only: this runs with Debian's tools and with those of macOS.

PYTHON = python3
BLENDER_PYTHON = python3.11
WORKERS = 2
VENV = .venv
READY = $(VENV)/.ready
# Idle threads sleep: two busy processes otherwise slow each other sixty times.
RUN = OMP_WAIT_POLICY=passive $(VENV)/bin
PIP = $(VENV)/bin/python -m pip --disable-pip-version-check

help:
	@echo "make demo    new motions from the bundled clip, into demo/"
	@echo "make test    all tests, on WORKERS=$(WORKERS) processes"
	@echo "make lint    style and types"
	@echo "make bench   the benchmarks in tools/"
	@echo "make docs    the documentation site, into build/site"
	@echo "make blender the Blender extension, into dist/"
	@echo "make test-blender   its tests in real Blender (950 MB, BLENDER_PYTHON=$(BLENDER_PYTHON))"
	@echo "make venv    only $(VENV), which the others make too; PYTHON=$(PYTHON) says with which Python"

venv: $(READY)

demo: $(READY)
	$(RUN)/motiongen sample output=demo

test: $(READY)
	$(RUN)/python -m pytest -n $(WORKERS) --dist loadgroup

lint: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

bench: $(READY)
	$(PIP) install --quiet -c constraints.txt -e '.[bench]'
	@for file in tools/bench_*.py; do \
		name=$$(basename "$$file" .py); echo "-- $$name"; $(RUN)/python -m "tools.$$name" || exit 1; \
	done

docs: $(READY)
	$(PIP) install --quiet -c constraints.txt -e '.[docs]'
	$(RUN)/python -m tools.list_errors docs/errors.md
	NO_MKDOCS_2_WARNING=1 $(RUN)/python -m mkdocs build --strict

# The extension imports nothing of motiongen: what it needs is in its folder.
blender: $(READY)
	@mkdir -p dist
	cd blender/motiongen_blender && ../../$(VENV)/bin/python -m zipfile -c ../../dist/motiongen_blender.zip *.py *.toml

test-blender: $(READY) .venv-blender/.ready
	MOTIONGEN_BLENDER_PYTHON=$(CURDIR)/.venv-blender/bin/python $(RUN)/python -m pytest tests/blender

.venv-blender/.ready:
	$(BLENDER_PYTHON) -m venv .venv-blender
	.venv-blender/bin/python -m pip install --quiet 'bpy==4.5.*'
	@touch $@

# An existing environment is brought up to date, not made anew: the pins are what counts.
$(READY): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
		echo "make: there is no '$(PYTHON)' here; install Python 3.10 or later, or name it: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
		echo "make: '$(PYTHON)' is $$($(PYTHON) --version 2>&1), and 3.10 or later is needed; name another: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "make: '$(PYTHON)' cannot make environments; install its venv module (Debian: apt install python3-venv)" >&2; exit 1; }
	@$(VENV)/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	$(PIP) install -c constraints.txt -e '.[video,plots,latent,web,test,lint]'
	@touch $(READY)

.PHONY: help venv demo test lint bench docs blender test-blender
