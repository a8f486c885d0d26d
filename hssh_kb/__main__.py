"""``python -m hssh_kb``: the command line, where ``hssh`` is not on the path."""

from hssh_kb.cli import main_and_exit

if __name__ == "__main__":
    main_and_exit()
