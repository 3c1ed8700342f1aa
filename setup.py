"""Build the filter kernel where there is a C compiler; without one the NumPy form serves."""

import sys

from setuptools import Extension, setup

GCC_FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-Wall", "-Wextra"]
FLAGS = [] if sys.platform == "win32" else GCC_FLAGS

setup(
    ext_modules=[
        Extension(
            "hdbench.filter._kernel",
            sources=["hdbench/filter/kernel/binding.c", "hdbench/filter/kernel/oscillator.c"],
            depends=["hdbench/filter/kernel/oscillator.h"],
            include_dirs=["hdbench/filter/kernel"],
            extra_compile_args=FLAGS,
            libraries=[] if sys.platform == "win32" else ["m"],
            define_macros=[("Py_LIMITED_API", "0x030B0000")],
            py_limited_api=True,
            optional=True,
        )
    ]
)
