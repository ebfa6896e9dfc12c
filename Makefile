# Everything a fresh Debian or Ubuntu with Python >= 3.11 needs. Both main targets do all set-up themselves.
#
#   make demo    the embedded demo, photographs to film        5 to 6 minutes on two cores
#   make test    linters, types, contracts and all tests       about 12 minutes on two cores

SHELL := /bin/bash
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
PLUGINS := $(sort $(wildcard plugins/*))
export PIP_DISABLE_PIP_VERSION_CHECK = 1

.PHONY: demo test setup system-libraries lint format clean

demo: setup
	@echo "== demo: a synthetic drone survey of a slope, photographs to film (5 to 6 minutes on two cores) =="
	$(BIN)/slideframe run --solver mpm_warp

test: setup lint
	@echo "== tests (about 11 minutes on two cores) =="
	$(BIN)/python -m pytest

lint: setup
	@echo "== ruff, mypy --strict, import contracts (about 1 minute) =="
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

setup: system-libraries $(READY)

$(READY): constraints.txt requirements-dev.txt framework/pyproject.toml $(PLUGINS:%=%/pyproject.toml)
	@echo "== set-up: virtual environment in .venv and the pinned packages (about 2 minutes and the downloads, the first time) =="
	@test -x $(BIN)/pip || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --requirement requirements-dev.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --no-build-isolation \
	  --editable "framework[compressed,geo,video]" $(PLUGINS:%=--editable %)
	@touch $@

# open3d links against the libraries; the names are Debian's and Ubuntu's. ldconfig is not on every user's path.
system-libraries:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "slideframe needs Python >= 3.11; name one with make PYTHON=python3.12"; exit 1; }
	@export PATH="$$PATH:/usr/sbin:/sbin"; missing=""; \
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || missing="$$missing python3-venv"; \
	for library in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libgomp.so.1:libgomp1; do \
	  ldconfig -p | grep -q "$${library%%:*}" || missing="$$missing $${library##*:}"; done; \
	if [ -n "$$missing" ]; then \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    echo "== installing system packages:$$missing =="; apt-get update -qq && apt-get install -y -qq $$missing; \
	  else echo "set-up needs system packages. Run this, then the same make again:"; \
	    echo "  sudo apt-get install$$missing"; exit 1; fi; fi

clean:
	rm -rf .venv runs
