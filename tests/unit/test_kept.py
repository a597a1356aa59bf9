"""Answers about an object are kept by it, and no longer than it lives."""

import gc
import pickle
import weakref

from toppling.models.ground.points import contact_of
from toppling.models.scene import Scene


def test_an_answer_is_worked_out_once_for_an_object_and_anew_for_its_equal():
    one, equal = Scene.block(0.1, 0.1, 0.3), Scene.block(0.1, 0.1, 0.3)
    assert contact_of(one) is contact_of(one)
    assert contact_of(one) is not contact_of(equal)
    assert contact_of(one.with_friction(0.5)) is not contact_of(one)


def test_answers_go_with_their_object_and_stay_behind_when_it_is_sent_elsewhere():
    scene = Scene.block(0.1, 0.1, 0.3)
    gone = weakref.ref(contact_of(scene))
    sent = pickle.dumps(scene)
    assert b"ContactModel" not in sent
    assert contact_of(pickle.loads(sent)).half_diagonal_m == gone().half_diagonal_m
    del scene
    gc.collect()
    assert gone() is None
