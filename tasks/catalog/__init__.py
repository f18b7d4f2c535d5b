"""Catalog: database of every resource, its state, and the requests that created it.

```
catalog = Catalog.open("sqlite:////home/ann/catalog.db", clock=lambda: datetime.now(UTC))
job = catalog.create(Resource.new(arn=…, kind="simulation-job", …), token=ClientToken.of(name, request))
if catalog.claim(job.arn, owner, lease_s=30):
    catalog.transition(job.arn, "prepare", owner=owner)
```

It runs on SQLite, one file that many processes of one machine share, and on PostgreSQL (tested with
15, and with psycopg from the extra `postgresql`) for several machines.
"""

from .catalog import Catalog, Stored
from .client_tokens import ClientToken, tokens_of
from .records import FirstLease, NewResource, Ownership, Page, Resource

__all__ = [
    "Catalog",
    "ClientToken",
    "FirstLease",
    "NewResource",
    "Ownership",
    "Page",
    "Resource",
    "Stored",
    "tokens_of",
]
