"""Many sensors in one command, by processes of this machine or of a cluster, to one table.

``run`` (in ``coordinator``) is the path: patterns → calibrations → keys → batches → parts → table
and page. Nothing is computed twice and nothing is lost: an outcome belongs to the content of its
files, and is completely on the disk before it is reported.
"""

from vibrident.lab.fleet.coordinator import Outcome, RunRequest, run
from vibrident.lab.fleet.orders import Orders
from vibrident.lab.fleet.schedulers import Dask, LocalScheduler, Scheduler

__all__ = ["Dask", "LocalScheduler", "Orders", "Outcome", "RunRequest", "Scheduler", "run"]
