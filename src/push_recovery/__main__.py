"""Run the command line as ``python -m push_recovery``."""
# The packages lie beside src and are mapped by package-dir, which pyright does not read:
# pyright: reportMissingImports=false

if __name__ == "__main__":
    from .eval.output.interrupt import end_at_ctrl_c

    end_at_ctrl_c()
    from .eval.cli.main import main

    raise SystemExit(main())
