"""Messages to the user and their log."""

from instdrive_app.messages import Messages


def test_one_message_is_taken_away_and_the_log_keeps_it():
    messages = Messages(clock=lambda: 0.0)
    messages.info("first")
    messages.error("second")
    messages.dismiss(messages.toasts[0])
    assert [message.text for message in messages.toasts] == ["second"]
    assert [message.text for message in messages.log] == ["first", "second"]
    messages.dismiss()
    assert messages.toasts == ()


def test_a_long_text_is_shown_until_it_is_read():
    now = 0.0
    messages = Messages(clock=lambda: now)
    messages.info("short")
    messages.info("what takes " * 10 + "longer to read")
    now = 5.0
    assert [message.text[:4] for message in messages.toasts] == ["what"]
    now = 10.0
    assert messages.toasts == ()
