"""Who is let in: requests as browsers send them, from this page, from others, with the token and without."""

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.play.gate import Gate, is_loopback, require_own

Headers = pytest.importorskip("websockets.datastructures", reason="needs the extra play").Headers
HERE = "127.0.0.1:8080"


def headers(**values):
    return Headers({name.capitalize(): value for name, value in values.items()})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"host": HERE, "origin": f"http://{HERE}"}, None),
        ({"host": "localhost:8080", "origin": "http://localhost:8080"}, None),
        ({"host": HERE, "origin": "http://evil.example"}, "own"),
        ({"host": HERE, "origin": "http://127.0.0.1:9999"}, "own"),
        ({"host": HERE, "origin": f"https://{HERE}"}, "own"),
        ({"host": HERE, "origin": "null"}, "own"),
        ({"host": HERE}, "own"),
        ({"host": "evil.example:8080", "origin": "http://evil.example:8080"}, "not this computer"),
        ({"origin": f"http://{HERE}"}, "not this computer"),
    ],
)
def test_only_this_servers_own_page_gets_a_connection(values, words):
    reason = Gate("127.0.0.1").refusal("/", headers(**values), True)
    assert reason is None if words is None else words in reason


def test_the_page_is_served_under_this_computers_name_alone():
    gate = Gate("127.0.0.1")
    assert gate.refusal("/", headers(host=HERE), False) is None
    assert gate.refusal("/", headers(host="rebound.example:8080"), False) is not None
    assert gate.token == ""


def test_from_elsewhere_a_token_is_asked_for_and_a_cookie_carries_it():
    gate, host = Gate("0.0.0.0"), "192.168.0.7:8080"  # noqa: S104
    assert len(gate.token) >= 12
    assert gate.token != Gate("0.0.0.0").token  # noqa: S104
    assert gate.address(8080).endswith(f":8080/?token={gate.token}")
    assert "token" in gate.refusal("/", headers(host=host), False)
    assert "token" in gate.refusal(f"/?token={gate.token}x", headers(host=host), False)
    assert gate.refusal(f"/?token={gate.token}", headers(host=host), False) is None
    page = {"host": host, "origin": f"http://{host}"}
    assert "token" in gate.refusal(f"/?token={gate.token}", headers(**page), True)  # the cookie it must be
    cookie = gate.cookie(8080)
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    kept = cookie.split(";")[0]
    assert gate.refusal("/", headers(**page, cookie=f"other=1; {kept}"), True) is None
    assert "token" in gate.refusal("/", headers(**page, cookie=f"{kept}x"), True)
    assert "own" in gate.refusal("/", headers(host=host, origin="http://evil", cookie=kept), True)


def test_a_token_of_ones_own_is_asked_for_on_this_computer_too():
    gate = Gate("127.0.0.1", "word")
    assert gate.address(8080) == "http://127.0.0.1:8080/?token=word"
    assert "token" in gate.refusal("/", headers(host=HERE), False)
    assert gate.refusal("/?token=word", headers(host=HERE), False) is None


def test_what_is_loopback():
    assert [is_loopback(host) for host in ("127.0.0.1", "127.1.2.3", "::1", "localhost")] == [True] * 4
    assert [is_loopback(host) for host in ("0.0.0.0", "::", "10.0.0.1", "name")] == [False] * 4  # noqa: S104


def test_a_host_that_is_not_this_computers_is_refused():
    require_own("127.0.0.1")
    with pytest.raises(InvalidValueError, match=r"203\.0\.113\.5.* is no address of this computer"):
        require_own("203.0.113.5")
