"""Run the command line as ``python -m hdbench_cli``."""

from hdbench_cli.main import main

main()
