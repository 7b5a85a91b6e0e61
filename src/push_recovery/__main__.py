"""Run the command line as ``python -m push_recovery``."""

from .eval.cli.main import main  # pyright: ignore[reportMissingImports]  # mapped by package-dir

if __name__ == "__main__":
    raise SystemExit(main())
