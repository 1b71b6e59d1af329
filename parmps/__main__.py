"""``python -m parmps``."""

from parmps.cli import main

if __name__ == "__main__":
    main()
