"""The editor as it is: ``python plain_editor.py ARGUMENTS`` takes those of `instdrive`."""

import sys

from instdrive_app.main import main

if __name__ == "__main__":
    sys.exit(main())
