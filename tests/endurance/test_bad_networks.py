"""A batch on two machines whose connections to S3, PostgreSQL and Prefect are slow, silent or cut: no job fails."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest
from helpers.batch_invariants import check_invariants, has_ended
from helpers.kill_rounds import Actor, kill_at_random
from helpers.mortal_prefect import MortalPrefectServer
from helpers.postgres_server import NEEDS_POSTGRESQL
from helpers.s3_server import MortalS3Server
from helpers.tcp_proxy import TcpProxy, tcp_proxy

from .conftest import keep, seed_of_the_run, wait_for_the_end

pytestmark = NEEDS_POSTGRESQL
JOBS = 12
SILENT_S = 6.0
SLOW_S, DELAY_S = 4.0, 0.1


@pytest.fixture
def networks(
    postgres_database: str, mortal_s3: MortalS3Server, mortal_prefect: MortalPrefectServer
) -> Iterator[dict[str, TcpProxy]]:
    """What stands between the machines and each server."""
    addresses = {
        "PostgreSQL": postgres_database,
        "S3": mortal_s3.server.endpoint,
        "Prefect": mortal_prefect.variables["PREFECT_API_URL"],
    }
    with ExitStack() as stack:
        yield {name: stack.enter_context(tcp_proxy(port_of(address))) for name, address in addresses.items()}


def port_of(address: str) -> int:
    port = urlsplit(address).port
    assert port is not None
    return port


def through(network: TcpProxy, address: str) -> str:
    return address.replace(f":{port_of(address)}", f":{network.port}", 1)


@pytest.fixture
def variables(
    postgres_database: str, mortal_s3: MortalS3Server, bucket: str, networks: dict[str, TcpProxy]
) -> dict[str, str]:
    return {
        **mortal_s3.server.environ(),
        "ROBOMAKER_BUCKET": bucket,
        "ROBOMAKER_CATALOG_URL": through(networks["PostgreSQL"], postgres_database),
        "ROBOMAKER_OBJECT_STORE": through(networks["S3"], mortal_s3.server.endpoint),
    }


@pytest.fixture
def prefect_variables(mortal_prefect: MortalPrefectServer, networks: dict[str, TcpProxy]) -> dict[str, str]:
    given = mortal_prefect.variables
    return {**given, "PREFECT_API_URL": through(networks["Prefect"], given["PREFECT_API_URL"])}


def silence(network: TcpProxy) -> None:
    network.silence()
    time.sleep(SILENT_S)
    network.restore()


def slow(network: TcpProxy) -> None:
    network.slow(DELAY_S)
    time.sleep(SLOW_S)
    network.restore()


@pytest.mark.deep
@pytest.mark.timeout(900)
@pytest.mark.parametrize("batch", [JOBS], indirect=True)
def test_no_job_fails_of_a_bad_network(
    batch: str,
    actors: dict[str, Actor],
    networks: dict[str, TcpProxy],
    postgres_database: str,
    bucket: str,
    mortal_s3: MortalS3Server,
) -> None:
    seed = seed_of_the_run()
    faults: dict[str, Callable[[TcpProxy], None]] = {"cut": TcpProxy.cut, "silent": silence, "slow": slow}
    targets: dict[str, Callable[[], None]] = {
        f"{name} {kind}": lambda make=make, network=network: make(network)
        for name, network in networks.items()
        for kind, make in faults.items()
    }
    is_over = lambda: has_ended(postgres_database, batch)  # noqa: E731
    made = kill_at_random(seed, 1000, targets, lambda: keep(actors), is_over, pause_s=(0.2, 2.0))
    wait_for_the_end(actors, postgres_database, batch)
    print(f"seed {seed}: {sum(made.values())} faults, {dict(made)}")
    check_invariants(postgres_database, batch, JOBS, mortal_s3.server.client("s3"), bucket, most_failed=0)
    assert sum(made.values()) >= JOBS // 2, "else the batch has shown little"
