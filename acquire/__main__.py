"""``python -m acquire``: the same as ``lumisplit``."""

from acquire.cli import main

main()
