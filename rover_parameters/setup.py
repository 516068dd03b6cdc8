# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Install the package where ament looks for it."""

from setuptools import find_packages, setup

NAME = "rover_parameters"

setup(
    name=NAME,
    version="0.1.0",
    description="Parameters and configuration files, declared once and read strictly",
    maintainer="The terrain_estimator authors",
    maintainer_email="terrain-estimator@example.com",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml", "LICENSE"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
