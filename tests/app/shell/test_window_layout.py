"""What is fixed before the window opens."""

from imgui_bundle import hello_imgui

from instdrive_app.shell.window_layout import WindowOptions, build_runner_parameters


def test_a_press_in_a_panel_is_the_widgets_own():
    """The mouse counts as touching; a finger's drag would scroll the panel, and no slider in it could be dragged."""
    parameters = build_runner_parameters(WindowOptions((640, 400)), [])
    assert parameters.touch_scroll_mode == hello_imgui.TouchScrollMode.disabled
    assert not parameters.touch_long_press_is_right_click
