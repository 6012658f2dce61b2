"""python -m glossbench: the command line."""

from glossbench.cli import main

if __name__ == "__main__":
    main()
