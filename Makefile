# `make help` is the index of everything one can do here.
SHELL := /bin/bash
PYTHON := .venv/bin/python
ARGS ?=
.DEFAULT_GOAL := help

##@ Start
.PHONY: help demo simulate
help: ## Show this list
	@awk 'BEGIN {FS = ":.*## "} /^##@/ {printf "\n\033[1m%s\033[0m\n", substr($$0, 5)} /^[a-z-]+:.*## / {printf "  \033[36m%-16s\033[0m %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: venv ## A wheelchair in a corridor while its link fails; ARGS="--mode cloud-only --no-ui"
	$(PYTHON) -m robot_offload demo $(ARGS)

simulate: venv ## The protocol in virtual time; ARGS="--hours 1 --seed 7"
	$(PYTHON) -m robot_offload.simulate $(ARGS)

##@ Check
.PHONY: test test-fast lint types verify fmt
test: venv ## All tests: unit, contract, simulation, real ROS processes
	$(PYTHON) -m pytest $(ARGS)

test-fast: venv ## Only what takes seconds
	$(PYTHON) -m pytest tests/unit tests/contract $(ARGS)

lint: venv ## Style and import directions
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/lint-imports --no-cache

types: venv ## mypy --strict
	.venv/bin/mypy

verify: venv ## Generated files are what the models say
	$(PYTHON) -m robot_offload.generate --check

fmt: venv ## Rewrite in the project's format
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

##@ Measure
.PHONY: bench-switch bench-operator
bench-switch: venv ## The switching figures of docs/benchmarks.md; ARGS="--quick"
	$(PYTHON) -m robot_offload.bench switch $(ARGS)

bench-operator: venv ## 200 RobotOffloads on a real API server; ARGS="--objects 50"
	$(PYTHON) -m robot_offload.bench.operator_scale $(ARGS)

##@ Build
.PHONY: images
images: venv ## Build our own images; ARGS="--wheels" where no container registry can be reached
	$(PYTHON) -m robot_offload.images.ours $(ARGS)

##@ Maintain
.PHONY: venv generate install-manifest cluster-binaries pins clean
generate: venv ## Write everything that is derived from the models: definition, reference
	$(PYTHON) -m robot_offload.generate

install-manifest: venv ## Write manifests/install.yaml from the chart (with the test cluster's helm)
	$(PYTHON) -m scripts.install_manifest

cluster-binaries: venv ## Build the test cluster's programs (once, some ten minutes; the tests do it by themselves)
	$(PYTHON) -m tests.cluster build

venv: ## Make or refresh .venv (the other targets do it by themselves)
	@python3 scripts/bootstrap.py

pins: ## Resolve requirements/all.txt anew from the groups of pyproject.toml
	uv pip compile --quiet --universal --python-version 3.12 --generate-hashes --no-emit-index-url --no-header \
	  --group pyproject.toml:ros --group pyproject.toml:operator --group pyproject.toml:dev -o requirements/all.txt

clean: ## Remove what was built here
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis out
