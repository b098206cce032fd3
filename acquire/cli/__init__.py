"""The command line: ``lumisplit``."""

from acquire.cli.main import main

__all__ = ["main"]
