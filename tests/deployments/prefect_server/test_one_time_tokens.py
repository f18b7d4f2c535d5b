"""Tokens of login links."""

from itertools import count

from prefect_robomaker.deployments.prefect_server.login_page import OneTimeTokens


def test_a_token_works_once() -> None:
    tokens = OneTimeTokens()

    first, second = tokens.issue(), tokens.issue()

    assert first != second
    assert len(first) >= 32
    assert [tokens.redeem(first), tokens.redeem(first), tokens.redeem(second)] == [True, False, True]
    assert not tokens.redeem("")
    assert not tokens.redeem("nonsense")


def test_a_token_that_is_too_old_does_not_work() -> None:
    now = [0.0]
    tokens = OneTimeTokens(life_s=600.0, clock=lambda: now[0])
    token, other = tokens.issue(), tokens.issue()

    now[0] = 599.9
    assert tokens.redeem(token)
    now[0] = 600.0
    assert not tokens.redeem(other)


def test_links_that_nobody_follows_do_not_pile_up() -> None:
    numbers = count()
    tokens = OneTimeTokens(make=lambda: f"token-{next(numbers)}")

    for _ in range(101):
        tokens.issue()

    assert not tokens.redeem("token-0")
    assert tokens.redeem("token-1")
    assert tokens.redeem("token-100")
