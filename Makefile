# make demo   train a synthetic drive, evaluate it, open (or script) the editor on it
# make test   style, types, import contracts and the whole test suite, in WORKERS processes (default 2) that take a file
#             of tests each
# make slow   the tests that are left out there: whole jobs and long walks through the window
# make lint   the same without the suite
# make catalogue   bring the catalogues of the window's languages up to date with its texts
# make docs   the documentation as a site in build/site; warnings are errors
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
PACKAGES := libegl1 libgl1 libgl1-mesa-dri libglx-mesa0 libx11-6 libxcursor1 libxext6 libxi6 libxinerama1 libxrandr2 \
	xvfb xauth xdotool python3-venv
RUN ?= runs/demo
WORKERS ?= 2

.PHONY: demo test slow docs lint style contracts types suite bench pictures catalogue system clean
.DEFAULT_GOAL := demo

demo: $(VENV)/.ready
	$(BIN)/instdrive demo --out $(RUN)

# pyright has one thread: it runs beside the suite, whose files wait for each other at the end.
test: $(VENV)/.ready-dev
	@$(MAKE) --no-print-directory style contracts
	@$(MAKE) --no-print-directory --jobs=2 --keep-going types suite

lint: style contracts types

style: $(VENV)/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

contracts: $(VENV)/.ready-dev
	$(BIN)/lint-imports --no-logo

# pyright does not follow pyproject's package-dir: it finds app/ under its import name through a link.
types: $(VENV)/.ready-dev
	@mkdir -p $(VENV)/paths && ln -sfn ../../app $(VENV)/paths/instdrive_app
	$(BIN)/pyright

# Kernels are compiled once; else every process that starts with the suite compiles them for itself.
suite: $(VENV)/.ready-dev
	@$(BIN)/python -m instdrive_core.training.warm_up & $(BIN)/python -m instdrive_app.render.software.warm_up; wait
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

slow: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --slow -m slow

docs: $(VENV)/.ready-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: $(VENV)/.ready-dev
	$(BIN)/python -m benchmarks.rasterize --workload W2 --state init
	$(BIN)/python -m benchmarks.rasterize --workload W2 --state trained

pictures: $(VENV)/.ready-dev
	$(BIN)/instdrive demo --script --out $(RUN)
	$(BIN)/python -m benchmarks.pictures $(RUN)/run --name demo --session $(RUN)
	$(BIN)/python -m benchmarks.editor_pictures $(RUN)/run
	$(BIN)/python -m instdrive_core.datasets.synthetic.contact_sheet $(RUN)/clip docs/images/synthetic_contact_sheet.jpg

catalogue: $(VENV)/.ready-dev
	$(BIN)/python -m benchmarks.catalogue

$(VENV)/bin/python: | system
	$(PYTHON) -m venv $(VENV)

$(VENV)/.ready: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[train]'
	touch $@

$(VENV)/.ready-dev: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

$(VENV)/.ready-docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	touch $@

# OpenGL, a virtual display and venv support come from Debian packages; nothing is installed when all are there.
system:
	@if command -v apt-get >/dev/null && ! dpkg-query -W $(PACKAGES) >/dev/null 2>&1; then \
		$(SUDO) apt-get update -qq && \
		DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $(PACKAGES); \
	fi

clean:
	rm -rf $(VENV) runs build dist *.egg-info
