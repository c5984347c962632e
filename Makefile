# `make help` is the index of everything one can do here.
SHELL := /bin/bash
PYTHON := .venv/bin/python
ARGS ?=
REGISTRY ?=
.DEFAULT_GOAL := help
# Many processes of the demo and the tests start the same modules: without cached bytecode each compiles them anew.
unexport PYTHONDONTWRITEBYTECODE

##@ Start
.PHONY: help demo simulate
help: ## Show this list
	@printf "%-10s %-42s %-7s %s\n" core/ "the pure switching core" agent/ "on the robot and in the cloud pod" \
	  operator/ "in the cluster, and the command line" lab/ "demo, simulation, benches, test cluster"
	@awk 'BEGIN {FS = ":.*## "} /^##@/ {printf "\n\033[1m%s\033[0m\n", substr($$0, 5)} /^[a-z-]+:.*## / {printf "  \033[36m%-16s\033[0m %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: venv ## A wheelchair in a corridor while its link fails; ARGS="--mode cloud-only --no-ui"
	$(PYTHON) -m robot_offload demo $(ARGS)

simulate: venv ## The protocol in virtual time; ARGS="--hours 1 --seed 7"
	$(PYTHON) -m robot_offload_sim $(ARGS)

##@ Check
PYTEST := $(PYTHON) -m pytest
BESIDE := -n 2 --dist loadfile
.PHONY: test test-all campaign test-fast test-pure test-integration test-nodes test-ros test-simulation cluster-programs
.PHONY: e2e e2e-full lint types verify fmt
test: venv cluster-programs ## What every commit runs: unit, contract, API server, stories, the demo, a core of real ROS processes
	@$(PYTHON) -m scripts.lacking
	$(PYTEST) $(BESIDE) tests/unit tests/golden tests/contract $(ARGS)
	$(PYTEST) $(BESIDE) -m "core and not cluster" tests/integration tests/simulation $(ARGS)
	$(PYTEST) -m core tests/ros $(ARGS)

test-all: venv cluster-programs ## The rest: every chart, cluster, ROS and simulation test that `make test` leaves out
	$(PYTEST) $(BESIDE) -m "not core and not cluster" tests/integration $(ARGS)
	$(PYTEST) -m cluster tests/integration $(ARGS)
	$(PYTEST) -m "not core" tests/ros $(ARGS)
	$(PYTEST) $(BESIDE) -m "not core and not campaign" tests/simulation $(ARGS)

campaign: venv ## Two hours of virtual time in storms: run it after a change of the protocol
	$(PYTEST) -m campaign tests/simulation $(ARGS)

cluster-programs:
	-@$(PYTHON) -m robot_offload_lab.cluster build > /dev/null  # shows its progress here; without Go those tests are skipped

test-pure: venv ## Unit, golden and contract tests, two at a time
	$(PYTEST) $(BESIDE) tests/unit tests/golden tests/contract $(ARGS)

test-integration: venv cluster-programs ## Tests with a real API server, two at a time
	$(PYTEST) $(BESIDE) -m "not cluster" tests/integration $(ARGS)

test-nodes: venv ## The test cluster with nodes; one at a time, because they share the machine's settings (root)
	$(PYTEST) -m cluster tests/integration $(ARGS)

test-ros: venv ## Real ROS processes; one at a time, because they watch the clock
	$(PYTEST) tests/ros $(ARGS)

test-simulation: venv ## The protocol in virtual time, and its mutants
	$(PYTEST) $(BESIDE) tests/simulation $(ARGS)

test-fast: venv ## Only what takes seconds
	$(PYTEST) tests/unit tests/contract $(ARGS)

e2e: venv ## The core of the end-to-end suite on a real cluster (root; ARGS="-k drive")
	$(PYTHON) -m pytest tests/e2e -m core $(ARGS)

e2e-full: venv ## The whole end-to-end suite: every transport, fault, upgrade (root)
	$(PYTHON) -m pytest tests/e2e $(ARGS)

lint: venv ## Style, import directions, messages of new commits
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/lint-imports --no-cache
	$(PYTHON) -m scripts.commit_messages

types: venv ## mypy --strict
	.venv/bin/mypy

verify: venv ## Generated files are what the models say
	$(PYTHON) -m scripts.generate --check

fmt: venv ## Rewrite in the project's format
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

##@ Measure
.PHONY: bench bench-switch bench-handover bench-hot bench-weight bench-links bench-operator bench-e2e
bench: venv ## A short form of every measurement; refreshes docs/benchmarks.md (some 15 minutes, idle machine); ARGS="--resume"
	$(PYTHON) -m robot_offload_lab.bench all --docs docs $(ARGS)

bench-e2e: venv ## The figures of the end-to-end suite: a real cluster, a robot outside it (root)
	$(PYTHON) -m tests.e2e.bench $(ARGS)

bench-switch: venv ## The switching figures of docs/benchmarks.md; ARGS="--full"
	$(PYTHON) -m robot_offload_lab.bench switch $(ARGS)

bench-handover: venv ## Goals and service calls through switches, cuts and a killed relay; ARGS="--full"
	$(PYTHON) -m robot_offload_lab.bench handover $(ARGS)

bench-hot: venv ## Hot standby: gaps of switches and cuts, false takeovers by silence; ARGS="--set hot_cuts=100"
	$(PYTHON) -m robot_offload_lab.bench hot $(ARGS)

bench-weight: venv ## Processor time and memory of both agents; ARGS="--set resources_s=60 --against COMMIT"
	$(PYTHON) -m robot_offload_lab.bench weight $(ARGS)

bench-links: venv ## What links carry of images and point clouds (root); ARGS="--full --resume"
	$(PYTHON) -m robot_offload_lab.bench.link_table --docs docs $(ARGS)

bench-operator: venv ## 200 RobotOffloads on a real API server; ARGS="--objects 50"
	$(PYTHON) -m robot_offload_lab.bench.operator_scale $(ARGS)

##@ Build
.PHONY: images dist release
dist: venv ## Wheels of all packages and a constraints file, into dist/
	$(PYTHON) -m scripts.dist $(ARGS)

release: venv ## Everything that a release publishes, into dist/: wheels, chart, plugin, images' digests, SBOM, checksums
	$(PYTHON) -m scripts.release $(if $(REGISTRY),--registry $(REGISTRY)) $(ARGS)

images: venv ## Build our own images; REGISTRY=... ARGS="--push"; ARGS="--wheels" where no registry can be reached
	$(PYTHON) -m robot_offload_lab.images.ours $(if $(REGISTRY),--registry $(REGISTRY)) $(ARGS)

##@ Maintain
.PHONY: venv generate golden install-manifest cluster-binaries pins clean
generate: venv ## Write everything that is derived from the models: definition, reference
	$(PYTHON) -m scripts.generate

golden: venv ## Write the golden files of tests/golden anew; look at the difference before you commit it
	UPDATE_GOLDEN=1 $(PYTHON) -m pytest -q tests/golden $(ARGS)
	git diff --stat -- tests/golden ':!*.py'

install-manifest: venv ## Write manifests/install.yaml from the chart (with the test cluster's helm)
	$(PYTHON) -m scripts.install_manifest

cluster-binaries: venv ## Build the test cluster's programs (once, some ten minutes; the tests do it by themselves)
	$(PYTHON) -m robot_offload_lab.cluster build
	$(PYTHON) -m robot_offload_lab.cluster build --nodes

venv: ## Make or refresh .venv (the other targets do it by themselves)
	@python3 scripts/bootstrap.py

pins: ## Resolve requirements/all.txt anew from the groups of pyproject.toml
	uv pip compile --quiet --universal --python-version 3.12 --generate-hashes --no-emit-index-url --no-header \
	  --group pyproject.toml:ros --group pyproject.toml:operator --group pyproject.toml:console --group pyproject.toml:lab --group pyproject.toml:dev -o requirements/all.txt

clean: ## Remove what was built here
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis out dist
