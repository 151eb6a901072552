"""The editor with much to say at once: five errors, as soon as a file called `SPEAK` lies beside the scene.

``python chatty_editor.py ARGUMENTS`` takes those of `instdrive`.
"""

import sys
import time
from pathlib import Path
from threading import Thread

from instdrive_app.main import main
from instdrive_app.messages import Messages

SPEAK = "speak"
TEXT = "This is told beside what the user is about to click, at some length, so that it takes several lines. " * 2


def _speak_later(messages, path):
    while not path.exists():
        time.sleep(0.01)
    for number in range(5):
        messages.error(f"{number}: {TEXT}")


if __name__ == "__main__":
    create = Messages.__init__

    def _create(messages, *arguments):
        create(messages, *arguments)
        scene = Path(sys.argv[sys.argv.index("edit") + 1])
        Thread(target=_speak_later, args=(messages, scene.with_name(SPEAK)), daemon=True).start()

    Messages.__init__ = _create
    sys.exit(main())
