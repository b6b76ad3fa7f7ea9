"""A function that asks and waits for its answers."""

import threading

import pytest

from calib.execution.conversation import Conversation


def test_a_conversation_ends_in_the_middle_and_at_the_end():
    def function(ask):
        try:
            return sum(ask([i])[0] for i in range(3))
        finally:
            ended.append(True)

    before, ended = threading.active_count(), []
    middle, whole = Conversation(function), Conversation(function)
    assert middle.waiting() == ("asked", [0])
    for i in range(3):
        assert whole.waiting() == ("asked", [i])
        whole.tell([10 * i])
    assert whole.waiting() == ("ended", 30)
    for conversation in (middle, whole, middle):
        conversation.close()
    assert ended == [True, True]
    assert threading.active_count() == before


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_whatever_the_function_raises_is_handed_over(error):
    def function(ask):
        raise error(ask("what"))

    conversation = Conversation(function)
    assert conversation.waiting() == ("asked", "what")
    conversation.tell("that")
    event, what = conversation.waiting()
    assert (event, type(what), what.args) == ("raised", error, ("that",))
    conversation.close()


def test_a_conversation_that_never_began_ends_too():
    before = threading.active_count()
    Conversation(lambda ask: ask(1)).close()
    assert threading.active_count() == before
