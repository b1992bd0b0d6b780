"""Packages of the wheel: the library, its configs as ``drape.conf`` and the entry points as ``drape.programs``."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages("src", include=["drape*"]), "drape.conf", "drape.programs"],
    package_dir={"": "src", "drape.conf": "conf", "drape.programs": "src"},
    include_package_data=False,
    package_data={
        "drape": ["report/*.yaml", "report/page.html", "report/page.css", "figure/*.yaml", "checkpoints/*"],
        "drape.conf": ["**/*.yaml"],
    },
)
