"""Undoing what `start_logging` does to the process, so that tests leave no handler behind."""

import logging
import threading


def stop_logging(handler):
    """Remove and close a log handler, and reset warnings and failures of threads."""
    logging.getLogger().removeHandler(handler)
    handler.close()
    logging.captureWarnings(False)
    threading.excepthook = threading.__excepthook__
