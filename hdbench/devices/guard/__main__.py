"""Safe state through the driver: the profile on standard input, exit code 0 when it is reached."""

from __future__ import annotations

import sys


def main() -> int:
    """Make the bench safe."""
    from hdbench.devices.opening import made_safe
    from hdbench.errors import HdbenchError
    from hdbench.profile.schema import ProfileData

    try:
        safe = made_safe(ProfileData.model_validate_json(sys.stdin.read()))
    except HdbenchError as error:
        sys.stdout.write(f"{error.where}: {error.what}\n")
        return error.exit_code
    if not safe.confirmed:
        sys.stdout.write(f"{safe.detail}\n")
    return 0 if safe.confirmed else 8


if __name__ == "__main__":
    sys.exit(main())
