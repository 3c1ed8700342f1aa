"""Build what is compiled where there is a C compiler; without one the Python forms serve."""

import os
import subprocess
import sys
import tempfile
from glob import glob

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

# -ffp-contract=off: the same bits on every processor; -fno-trapping-math: choices become selects
GCC_FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-trapping-math"]
GCC_FLAGS += ["-g0", "-Wall", "-Wextra", "-Wno-psabi"]
PROBE = """
#pragma GCC push_options
#pragma GCC target("avx512f")
typedef double wide __attribute__((vector_size(64)));
static wide twice(wide a) { return a + a; }
#pragma GCC pop_options
int main(void) { return __builtin_cpu_supports("avx512f") && sizeof(wide) == 1; }
"""


class Build(build_ext):
    """Add a version per width of the processor's vectors where the compiler can choose one."""

    def build_extensions(self) -> None:
        if self.compiler.compiler_type == "unix" and self.compiles_versions():
            for extension in self.extensions:
                extension.define_macros.append(("HDB_MULTIVERSION", "1"))
        super().build_extensions()

    def compiles_versions(self) -> bool:
        with tempfile.TemporaryDirectory() as folder:
            source = os.path.join(folder, "probe.c")
            with open(source, "w") as file:
                file.write(PROBE)
            command = [*self.compiler.compiler, "-c", source, "-o", os.path.join(folder, "probe.o")]
            try:
                version = subprocess.run(
                    [self.compiler.compiler[0], "--version"], capture_output=True, text=True
                ).stdout
                built = subprocess.run(command, capture_output=True).returncode == 0
            except OSError:
                return False
        # clang takes other pragmas for targets
        return built and "clang" not in version


KERNEL = "hdbench/filter/kernel"


def extension(name: str, folder: str) -> Extension:
    """Compile every source in a folder; without a compiler the installation goes on."""
    return Extension(
        name,
        sources=sorted(glob(f"{folder}/*.c")),
        depends=sorted(glob(f"{folder}/*.h")),
        include_dirs=[folder],
        define_macros=[("Py_LIMITED_API", "0x030B0000")],
        extra_compile_args=[] if sys.platform == "win32" else GCC_FLAGS,
        libraries=[] if sys.platform == "win32" else ["m"],
        py_limited_api=True,
        optional=True,
    )


setup(
    cmdclass={"build_ext": Build},
    packages=[*find_packages(include=["hdbench*"]), *find_packages("cli"), "hdbench_profiles"],
    package_dir={
        "hdbench": "hdbench",
        "hdbench_cli": "cli/hdbench_cli",
        "hdbench_profiles": "profiles",
    },
    ext_modules=[extension("hdbench.filter._kernel", KERNEL)],
)
