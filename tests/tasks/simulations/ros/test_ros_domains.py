import logging
import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from prefect_robomaker.tasks.simulations.ros.ros_domains import DOMAINS, own_domain

HOLD = """
import signal, sys
from prefect_robomaker.tasks.simulations.ros.ros_domains import own_domain
with own_domain(*sys.argv[1:]) as domain:
    print(domain, flush=True)
    signal.pause()
"""

HOLDERS = f"test-{os.getpid()}"
"""Jobs of other tests, which run at the same time, have domains too."""


def test_jobs_at_the_same_time_have_different_domains_that_no_default_is() -> None:
    with ExitStack() as stack:
        domains = [stack.enter_context(own_domain("the same job", HOLDERS)) for _ in range(30)]
    assert len(set(domains)) == 30
    assert set(domains) <= set(range(1, 102))


def test_a_job_has_the_same_domain_again_and_others_most_likely_another() -> None:
    """So jobs on two machines of one network seldom meet."""
    domains = []
    for job in ("a", "a", *map(str, range(100))):
        with own_domain(job, HOLDERS) as domain:
            domains.append(domain)
    assert domains[0] == domains[1]
    assert len(set(domains)) > 50


def test_jobs_of_other_processes_count_until_they_have_died() -> None:
    with own_domain("a", HOLDERS) as wanted:
        pass
    with subprocess.Popen([sys.executable, "-c", HOLD, "a", HOLDERS], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert int(other.stdout.readline()) == wanted
        with own_domain("a", HOLDERS) as domain:
            assert domain != wanted
        other.send_signal(signal.SIGKILL)
    with own_domain("a", HOLDERS) as domain:
        assert domain == wanted


def test_more_jobs_than_domains_share_them(caplog: pytest.LogCaptureFixture) -> None:
    with own_domain("a", HOLDERS) as wanted:
        pass
    with ExitStack() as stack, caplog.at_level(logging.WARNING):
        taken = {stack.enter_context(own_domain("a", HOLDERS)) for _ in DOMAINS}
        assert not caplog.records
        assert taken == set(DOMAINS)
        assert stack.enter_context(own_domain("a", HOLDERS)) == wanted
    assert f"domain {wanted}, which another job has too" in caplog.text
