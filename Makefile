# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
#
# Every target does its own set-up, once. ARGS is handed on: make test ARGS="-k pairing", make demo ARGS="--help".
.PHONY: help demo discover test test-long colcon-test first-use lint train accuracy long change stream recursion planner net paper calibrate hidden hidden-full faults million fuzz mutants bench soak foreign foreign-bag foreign-discovery foreign-turns robustness measured names independent-reference lateral off-plane by-wheel sensors velocity-alone pages docs pictures measures sbom audit workspace environment clean

LIBRARIES := .:rover_parameters:terramechanics:terrain_estimator:rover_sim_node
VENV_PYTHON := .venv/bin/python

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' Makefile

demo: workspace  ## drive, estimate, record and replay in one go; results in out/demo
	ros2_ws/bin/ros2 run terrain_estimator demo $(ARGS)

discover: workspace  ## hide an effect in a simulated rover, find it blind, unseal, open the report; results in out/discover
	ros2_ws/with python -m tests.terrain_estimator.discovery.discover $(ARGS)

test: workspace  ## all tests, slow ones on a short sample, in two processes (ARGS="-n 0" for one)
	OMP_NUM_THREADS=1 ros2_ws/with python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(ARGS)

test-long: workspace  ## all tests, nothing left out
	LONG_TESTS=1 $(MAKE) test

colcon-test: workspace  ## the tests that each ROS package declares, as colcon runs them
	cd ros2_ws && ./with colcon test --return-code-on-test-failure $(ARGS)
	cd ros2_ws && ./with colcon test-result --all

first-use: workspace  ## run the commands of README and getting started twice as written, 6 minutes
	FIRST_USE=whole ros2_ws/with python -m pytest tests/system/test_first_use.py $(ARGS)

lint: environment  ## ruff, mypy and the import contract
	$(VENV_PYTHON) -m ruff check
	$(VENV_PYTHON) -m ruff format --check
	$(VENV_PYTHON) -m mypy
	PYTHONPATH=$(LIBRARIES) .venv/bin/lint-imports

train: workspace  ## make the models that ship anew, also for varying ground and with a net; results in out/models
	ros2_ws/bin/ros2 run terrain_estimator train $(ARGS)
	ros2_ws/bin/ros2 run terrain_estimator train --ground-variation 0.02 $(ARGS)
	ros2_ws/bin/ros2 run terrain_estimator train --columns 6 $(ARGS)

accuracy: workspace  ## judge the estimator on simulated drives: docs/accuracy.md
	ros2_ws/with python -m studies.accuracy $(ARGS)

long: workspace  ## judge the intervals after minutes and an hour on one ground, 90 minutes of one core: docs/long_drives.md
	ros2_ws/with python -m studies.long $(ARGS)

change: workspace  ## judge how soon a change of the ground is found: docs/change.md
	ros2_ws/with python -m studies.change $(ARGS)

stream: workspace  ## judge what the estimator publishes with default parameters, half an hour of one core: docs/stream_study.md
	ros2_ws/with python -m studies.stream $(ARGS)

foreign: workspace  ## judge the estimator on drives of another engine, 20 minutes of one core: docs/foreign.md
	ros2_ws/with python -m studies.foreign $(ARGS)

foreign-discovery: workspace  ## search for the missing effect of those drives, 15 minutes of one core: docs/foreign_discovery.md
	ros2_ws/with python -m studies.foreign_discovery --jobs 1 $(ARGS)

foreign-turns: workspace  ## judge models by wheel on another engine's turns, for docs/lateral.md, 20 minutes of one core
	ros2_ws/with python -m studies.foreign.turns $(ARGS)

foreign-bag: workspace  ## turn one of those drives into a bag: make foreign-bag ARGS="A_cruise_tracks --out out/foreign/A_cruise_tracks"
	ros2_ws/with python -m studies.foreign.bag $(ARGS)

robustness: workspace  ## judge what is published where the world is not the model's, 25 minutes of one core: docs/robustness.md
	ros2_ws/with python -m studies.robustness $(ARGS)

lateral: workspace  ## the bound of a minute of skid steering, for docs/lateral.md, 15 minutes of one core
	ros2_ws/with python -m studies.lateral $(ARGS)

off-plane: workspace  ## what turns and cross slopes do to the estimate, for docs/lateral.md, 15 minutes of one core
	ros2_ws/with python -m studies.off_plane $(ARGS)

sensors: workspace  ## what each sensor is worth, for docs/bring_your_own_sensors.md, 25 minutes of one core
	ros2_ws/with python -m studies.sensors $(ARGS)

velocity-alone: workspace  ## what the velocity row alone tells, for docs/bring_your_own_data.md, 20 minutes of one core
	ros2_ws/with python -m studies.velocity_alone $(ARGS)

measured: workspace  ## judge the contact law on wheels that laboratories measured, 6 minutes of one core: docs/measured.md
	ros2_ws/with python -m studies.measured $(ARGS)

names: workspace  ## false names on simulated tables of one wheel, 25 minutes of one core: docs/false_names.md
	ros2_ws/with python -m studies.false_names $(ARGS)

independent-reference: workspace  ## judge the estimator beside a posterior that shares no rows with it, 1 h of one core: docs/independent_reference.md
	ros2_ws/with python -m studies.independent_reference $(ARGS)

recursion: workspace  ## judge a recursion that never relinearises beside the model's: docs/recursion.md
	ros2_ws/with python -m studies.recursion $(ARGS)

planner: workspace  ## drive into soft patches and count what the planner's stop saves: out/planner_study.json
	ros2_ws/with python -m studies.planner $(ARGS)

net: workspace  ## what the learnt features are worth on plants with hidden effects: out/net_study.json
	ros2_ws/with python -m studies.net $(ARGS)

paper: workspace  ## the paper's experiments: tables and pictures in out/paper
	ros2_ws/with python -m studies.paper $(ARGS)

calibrate: workspace  ## thresholds of find_missing_effect anew: out/thresholds.json
	ros2_ws/with python -m studies.calibration $(ARGS)

hidden: workspace  ## how often verdicts about hidden effects are right, at most 40 minutes on two cores: docs/hidden.md
	ros2_ws/with python -m tests.hidden.judge $(ARGS)

hidden-full: workspace  ## the same with many more cases, on a dask scheduler by ARGS="--scheduler HOST:PORT"
	ros2_ws/with python -m tests.hidden.judge --full --minutes 0 $(ARGS)

faults: workspace  ## the fault matrix with real processes, 6 to 20 minutes: docs/faults.md
	ros2_ws/with python -m tests.faults $(ARGS)

million: workspace  ## a million updates with mad sensors and clocks, an hour of one core: docs/faults.md
	ros2_ws/with python -m tests.faults.million $(ARGS)

fuzz: workspace  ## fuzz all readers of files, 78 minutes on one core; ARGS="--only bag --mutations 10000" for random damage: docs/faults.md
	$(VENV_PYTHON) -m pip install --quiet --no-deps --require-hashes --requirement tests/fuzz/requirements.txt
	ros2_ws/with python -m tests.fuzz $(ARGS)

mutants: workspace  ## change 300 places of the library one by one, do the tests notice? 3 hours on two cores: out/mutants.md
	OMP_NUM_THREADS=1 ros2_ws/with python -m tests.mutants $(ARGS)

bench: workspace  ## measure every speed that has a bar, beside references: out/bench.json, docs/benchmarks.md
	OMP_NUM_THREADS=1 ros2_ws/with python -m benchmarks $(ARGS)

soak: workspace  ## run three rovers for long, 38 minutes with four processors, 50 with two: does memory, a counter or a rate drift? out/soak.json, docs/faults.md
	OMP_NUM_THREADS=1 ros2_ws/with python -m benchmarks.soak $(ARGS)

by-wheel: workspace  ## what a model by wheel learns in turns, 45 minutes of one core: the tables of docs/lateral.md
	OMP_NUM_THREADS=1 ros2_ws/with python -m studies.by_wheel $(ARGS)

pages: workspace  ## write the pages and parameter files that follow from the code
	ros2_ws/with python -m docs.pages
	$(VENV_PYTHON) -m tools.pictures.nodes

pictures: workspace  ## take the pictures of the live page and of a found effect again, 3 minutes: docs/images
	ros2_ws/with python -m tools.pictures.screens

docs: environment  ## build the site of the pages and the API reference, check its links: out/site/index.html
	$(VENV_PYTHON) -m pip install --quiet --no-deps --only-binary ':all:' --require-hashes --requirement requirements/docs.txt
	NO_MKDOCS_2_WARNING=1 $(VENV_PYTHON) -m mkdocs build --quiet --strict $(ARGS)

measures: environment  ## measure the code's form, beside an earlier commit: make measures ARGS="--before COMMIT --write docs/architecture.md"
	$(VENV_PYTHON) -m tools.measures $(ARGS)

sbom: environment  ## list all installed packages with versions and licences, in CycloneDX's form: out/sbom.json
	$(VENV_PYTHON) -m tools.supply_chain sbom

audit: environment  ## look the pinned packages up among known vulnerabilities, by pip-audit
	$(VENV_PYTHON) -m tools.supply_chain audit

workspace: environment  ## set up and build, and start nothing
	@ros2_ws/compile

environment:
	@ros2_ws/prepare

clean:  ## remove what was built (not the environment, not recordings)
	rm -rf ros2_ws/build ros2_ws/install ros2_ws/log
