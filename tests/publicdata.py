"""Public records beside the project: the folder that HDBENCH_DATA names."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("HDBENCH_DATA", ""))
needs_data = pytest.mark.skipif("HDBENCH_DATA" not in os.environ, reason="HDBENCH_DATA is not set")
