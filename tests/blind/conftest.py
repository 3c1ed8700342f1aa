"""Makes the injector, the scorer and the runner importable for these tests alone."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent.parent / "tools" / "blind"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
