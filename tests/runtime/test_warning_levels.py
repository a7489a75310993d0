"""Levels of warnings."""

import json
import pickle

from torchsphere.runtime.warning_levels import CAUTION, NOTE, SEVERE, by_level, level_of, note, severe


def test_the_severe_sentences_come_first_and_each_level_keeps_its_order() -> None:
    said = (note("a"), "b", severe("c"), note("d"), severe("e"), "f")
    assert by_level(said) == ("c", "e", "b", "f", "a", "d")
    assert [level_of(text) for text in by_level(said)] == [SEVERE, SEVERE, CAUTION, CAUTION, NOTE, NOTE]


def test_a_sentence_with_a_level_is_text_and_keeps_its_level_between_processes() -> None:
    sentence = severe("wrong")
    assert sentence == "wrong"
    assert json.dumps([sentence]) == '["wrong"]'
    assert level_of(pickle.loads(pickle.dumps(sentence))) == SEVERE
