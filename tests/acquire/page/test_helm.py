from __future__ import annotations

from acquire.page.helm import SILENCE_S, Helm


def test_the_first_commands_and_the_second_watches() -> None:
    helm = Helm().joined(1).joined(2)
    assert helm.holder == 1


def test_control_is_handed_over_only_by_its_holder() -> None:
    helm = Helm().joined(1).joined(2).joined(3).asked(2, 0.0)
    assert helm.answered(3, hand_over=True) == helm
    assert helm.answered(1, hand_over=True) == Helm(2)
    assert helm.answered(1, hand_over=False) == Helm(1)


def test_who_asks_second_does_not_displace_who_asked_first() -> None:
    helm = Helm(1).asked(2, 0.0).asked(3, 1.0)
    assert helm.asking == 2


def test_silence_hands_over_and_nothing_earlier_does() -> None:
    helm = Helm(1).asked(2, 100.0)
    assert helm.at(100.0 + SILENCE_S - 0.1).holder == 1
    assert helm.at(100.0 + SILENCE_S).holder == 2
    assert Helm(1).at(1e9).holder == 1


def test_a_closed_browser_leaves_control_to_who_asked_or_to_nobody() -> None:
    assert Helm(1).asked(2, 0.0).left(1) == Helm(2)
    assert Helm(1).left(1) == Helm()
    assert Helm(1).asked(2, 0.0).left(2) == Helm(1)
    assert Helm(1).left(5) == Helm(1)
    assert Helm().asked(4, 0.0) == Helm(4)
    assert Helm(4).given_up(4) == Helm()
    assert Helm(4).given_up(5) == Helm(4)
