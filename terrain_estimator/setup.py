# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Install the package where ament looks for it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "terrain_estimator"

setup(
    name=NAME,
    version="0.1.0",
    description="Recursive Bayesian terrain estimator",
    maintainer="The terrain_estimator authors",
    maintainer_email="terrain-estimator@example.com",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(),
    package_data={
        NAME: [
            "py.typed",
            "models/*",
            "compiled/runtime/*",
            "discovery/evidence/*.json",
            "pages/templates/*",
            "dashboard/static/*",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "LICENSE"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/layouts", sorted(glob("layouts/*"))),
        (f"share/{NAME}/rviz", sorted(glob("rviz/*"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "estimator = terrain_estimator.nodes.estimator:main",
            "onboard = terrain_estimator.nodes.onboard:main",
            "recorder = terrain_estimator.nodes.recorder:main",
            "replay = terrain_estimator.cli.replay:main",
            "add_slip = terrain_estimator.cli.add_slip:main",
            "recover_bag = terrain_estimator.cli.recover_bag:main",
            "csv_to_bag = terrain_estimator.cli.csv_to_bag:main",
            "import_rose = terrain_estimator.cli.import_rose:main",
            "import_urdf = terrain_estimator.cli.import_urdf:main",
            "train = terrain_estimator.cli.train:main",
            "add_effect = terrain_estimator.cli.add_effect:main",
            "fleet = terrain_estimator.cli.fleet:main",
            "export_core = terrain_estimator.cli.export_core:main",
            "export_urdf = terrain_estimator.cli.export_urdf:main",
            "model_by_wheel = terrain_estimator.cli.model_by_wheel:main",
            "find_missing_effect = terrain_estimator.cli.find_missing_effect:main",
            "demo = terrain_estimator.cli.demo:main",
            "rate_check = terrain_estimator.cli.rate_check:main",
            "watch = terrain_estimator.nodes.watch:main",
            "dashboard = terrain_estimator.nodes.dashboard:main",
            "planner = terrain_estimator.nodes.planner:main",
            "slip_source = terrain_estimator.nodes.slip_source:main",
            "terrain_map = terrain_estimator.nodes.terrain_map:main",
            "selftest = terrain_estimator.cli.selftest:main",
        ],
    },
)
