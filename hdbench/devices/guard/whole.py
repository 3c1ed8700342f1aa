"""Make a bench safe through its driver: the profile on standard input, exit code 0 when it is."""

from __future__ import annotations

import sys


def main() -> int:
    """Make the bench safe."""
    from hdbench.devices.hosted import HostedBench, host_settings
    from hdbench.devices.registry import open_daq
    from hdbench.errors import HdbenchError
    from hdbench.profile.schema import ProfileData

    try:
        profile = ProfileData.model_validate_json(sys.stdin.read())
        bench = HostedBench(open_daq(profile, profile.daq), host_settings(profile))
        try:
            bench.identity()
            safe = bench.safe_state()
        finally:
            bench.close()
    except HdbenchError as error:
        sys.stdout.write(f"{error.where}: {error.what}\n")
        return error.exit_code
    if not safe.confirmed:
        sys.stdout.write(f"{safe.detail}\n")
    return 0 if safe.confirmed else 8


if __name__ == "__main__":
    sys.exit(main())
