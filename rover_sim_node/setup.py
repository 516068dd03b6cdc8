# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Install the package where ament looks for it."""

from glob import glob

from setuptools import find_packages, setup

NAME = "rover_sim_node"

setup(
    name=NAME,
    version="0.1.0",
    description="A simulated planar rover on deformable ground",
    maintainer="The terrain_estimator authors",
    maintainer_email="terrain-estimator@example.com",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "LICENSE"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "simulator = rover_sim_node.simulator:main",
        ],
    },
)
