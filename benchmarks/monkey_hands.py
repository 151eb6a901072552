"""True mouse and key events for the window that has the display to itself, through one running xdotool."""

from __future__ import annotations

import subprocess


class Hands:
    """Sends events; they arrive some milliseconds later."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            ["xdotool", "-"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
        )
        self._held: set[str] = set()

    def move(self, x: float, y: float) -> None:
        """Bring the pointer to a place of the window (pixels)."""
        self._do(f"mousemove {round(x)} {round(y)}")

    def press(self, button: int) -> None:
        """Hold a mouse button down."""
        self._do(f"mousedown {button}")

    def release(self, button: int) -> None:
        """Let a mouse button go."""
        self._do(f"mouseup {button}")

    def hold(self, key: str) -> None:
        """Hold a key down."""
        self._held.add(key)
        self._do(f"keydown {key}")

    def let_go(self) -> None:
        """Release all keys that are held."""
        for key in sorted(self._held):
            self._do(f"keyup {key}")
        self._held.clear()

    def type(self, text: str) -> None:
        """Type letters and digits."""
        self._do(f"type --delay 5 {text}")

    def close(self) -> None:
        """Let everything go and end."""
        self.let_go()
        for button in (1, 2, 3):
            self.release(button)
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10)

    def _do(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
