"""Starts `proxops`. Importing typer takes time, so it is done where Ctrl-C is handled."""

import sys


def main() -> None:
    """Runs `proxops.cli.main.main`."""
    try:
        from proxops.cli.main import main as run
    except KeyboardInterrupt:
        print("proxops: interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
