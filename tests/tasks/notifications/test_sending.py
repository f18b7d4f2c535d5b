"""Messages reach a real webhook and a real mail server, and what does not work is told without secrets."""

import base64
import threading
from urllib.parse import quote

import pytest
from helpers.receivers import MailServer, Webhook

from prefect_robomaker.tasks.notifications import sending
from prefect_robomaker.tasks.notifications.notification_texts import Message
from prefect_robomaker.tasks.notifications.sending import send, unknown_channels

MESSAGE = Message(
    "night: failed, 1 of 2 jobs passed, 1 failed", "1. sim-b: goal: 2 of 5 rooms\n.\nReport: /r", good=False
)
PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def test_a_webhook_gets_the_message_and_the_pictures(webhook: Webhook) -> None:
    assert send([f"json://{webhook.address}/hook"], MESSAGE, {"1-sim-b.png": PNG}) == []

    (got,) = webhook.got
    assert (got["title"], got["message"], got["type"]) == (MESSAGE.title, MESSAGE.body, "failure")
    (attached,) = got["attachments"]
    assert (attached["filename"], base64.b64decode(attached["base64"])) == ("1-sim-b.png", PNG)


def test_a_mail_server_gets_the_message_and_the_pictures(mail_server: MailServer) -> None:
    to = quote("team@example.org")
    assert (
        send([f"mailto://{mail_server.address}?from=bot@example.org&to={to}&format=text"], MESSAGE, {"a.png": PNG})
        == []
    )

    (got,) = mail_server.got
    assert got["Subject"] == MESSAGE.title
    assert "team@example.org" in got["To"]
    text = got.get_body(("plain",))
    assert text is not None
    assert "1. sim-b: goal: 2 of 5 rooms" in text.get_content()
    (picture,) = got.iter_attachments()
    assert (picture.get_filename(), picture.get_content()) == ("a.png", PNG)


def test_one_channel_that_fails_does_not_keep_the_others_from_being_told(webhook: Webhook) -> None:
    refusing = f"json://user:hunter2@{webhook.address}/s3cret"
    webhook.status = 500

    problems = send([refusing, "nonsense://hunter2"], MESSAGE, {})

    assert len(webhook.got) == 1
    assert problems[0].startswith("channel 1 of ROBOMAKER_NOTIFY, json://")
    assert "500" in problems[0]
    assert problems[1] == "channel 2 of ROBOMAKER_NOTIFY is no address that apprise knows"
    assert "hunter2" not in "".join(problems)
    assert "s3cret" not in "".join(problems), "the path of a webhook is often what lets one in"


@pytest.mark.parametrize(
    "url",
    [
        "jsons://127.0.0.1:1/services/T0s3cret/B0s3cret",
        "json://127.0.0.1:1/?+X-Token=s3cret",
        "mailto://127.0.0.1:1?from=bot@example.org&to=s3cret@example.org",
        "tgram://123456789:s3cretabcdefghijklmnopqrstuvwxyz0/s3cret",
        "slack://s3cret1AA/s3cret2BB/s3cretAbCdEfGhIjKlMnOpQr/#s3cret",
        "discord://127000000000000000/s3cretabcdefghijklmnopqrstuvwxyz",
    ],
)
def test_a_channel_is_called_by_its_service_and_host(url: str) -> None:
    (channel,) = sending._channels([url])
    assert channel is not None

    shown = sending._shown(channel)

    assert shown.startswith(url.partition("://")[0] + "://")
    assert "s3cret" not in shown


def test_nobody_there_is_told_without_secrets() -> None:
    (problem,) = send(["json://user:hunter2@127.0.0.1:1/path"], MESSAGE, {})

    assert problem.startswith("channel 1 of ROBOMAKER_NOTIFY, json://")
    assert "hunter2" not in problem


def test_a_channel_that_hangs_is_not_waited_for(webhook: Webhook) -> None:
    webhook.wait = threading.Event()
    try:
        problems = send([f"json://{webhook.address}/?rto=30"], MESSAGE, {}, timeout_s=0.3)
    finally:
        webhook.wait.set()

    assert problems == ["channel 1 of ROBOMAKER_NOTIFY: no answer within 0.3 s"]


def test_addresses_that_apprise_does_not_know_are_named_by_their_place() -> None:
    assert unknown_channels(["json://a/b", "jsn://hunter2"]) == [
        "channel 2 of ROBOMAKER_NOTIFY is no address that apprise knows"
    ]
