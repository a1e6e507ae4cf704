"""The public names for editors and type checkers: ``__init__.py`` loads each when it is first used."""

from vibrident.base.errors import InputError as InputError
from vibrident.base.errors import ModelError as ModelError
from vibrident.base.errors import NotConverged as NotConverged
from vibrident.base.errors import VibridentError as VibridentError
from vibrident.base.version import __version__ as __version__
from vibrident.data.io import read as read
from vibrident.data.known import KnownResponse as KnownResponse
from vibrident.data.records import Calibration as Calibration
from vibrident.data.records import Provenance as Provenance
from vibrident.data.records import Record as Record
from vibrident.data.records import ResponseTable as ResponseTable
from vibrident.fit.estimators import Ipnn as Ipnn
from vibrident.fit.estimators import MaximumLikelihood as MaximumLikelihood
from vibrident.fit.joint import identify_together as identify_together
from vibrident.lab.many import identify_many as identify_many
from vibrident.paper.estimators.lsm import LeastSquares as LeastSquares
from vibrident.physics.models import Model as Model
from vibrident.physics.models import ParameterSpec as ParameterSpec
from vibrident.physics.simulation import simulate as simulate
from vibrident.result import Result as Result
from vibrident.result.sensor import IdentifiedSensor as IdentifiedSensor
from vibrident.use.correction import correct as correct
from vibrident.use.identification import identify as identify
from vibrident.use.planning import plan as plan
from vibrident.use.prediction import predict as predict
