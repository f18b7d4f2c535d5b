"""The server's log has no traceback; the fixture `prefect_server` looks at it again when all tests are done."""

from helpers.prefect_server import server_settings
from helpers.server_log import tracebacks, where_it_was_stuck

LOCKED = """\
Traceback (most recent call last):
  File "a.py", line 1, in <module>
    write()
sqlite3.OperationalError: database is locked

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "b.py", line 2, in f
    raise Other

sqlalchemy.exc.OperationalError: (sqlite3.OperationalError) database is locked
[SQL: UPDATE flow_run]
"""
DEFECT = """\
12:00:00 ERROR | prefect.server.services.scheduler - Unexpected error
Traceback (most recent call last):
  File "a.py", line 1, in <module>
    evaluate()
InvalidRequestError: Can't evaluate bulk DML statement
12:00:01 INFO | fine
"""


def test_tracebacks_are_found_by_their_last_lines() -> None:
    assert tracebacks("") == []
    cause, locked, defect = tracebacks(LOCKED + DEFECT)
    assert cause.endswith("sqlite3.OperationalError: database is locked")
    assert locked.endswith("(sqlite3.OperationalError) database is locked")
    assert defect.endswith("InvalidRequestError: Can't evaluate bulk DML statement")


def test_the_server_has_logged_none(prefect_server: str) -> None:
    del prefect_server
    assert not tracebacks((server_settings().home / "prefect" / "server.log").read_text(errors="replace"))


STUCK = """\
Timeout (0:00:15)!
Thread 0x00007f (most recent call first):
  File "a.py", line 1 in loop

Thread 0x00008f (most recent call first):
  File "b.py", line 2 in wait
"""


def test_stacks_of_a_server_that_was_stuck_are_found() -> None:
    assert where_it_was_stuck(f"12:00:00 | INFO | fine\n{STUCK}12:00:20 | INFO | fine\n") == STUCK.strip()
    assert where_it_was_stuck(DEFECT) == ""
