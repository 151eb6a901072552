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
