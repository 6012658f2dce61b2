"""python -m glossbench: the command line."""

from glossbench.commands.cli import main

if __name__ == "__main__":
    main()
