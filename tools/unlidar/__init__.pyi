# The names of `import unlidar`, for type checkers, and for __init__.py, which imports them from
# these modules on first access.
from unlidar.api import Conversion as Conversion
from unlidar.api import ConvertOptions as ConvertOptions
from unlidar.api import DroneMeasures as DroneMeasures
from unlidar.api import EvaluateOptions as EvaluateOptions
from unlidar.api import Measures as Measures
from unlidar.api import Run as Run
from unlidar.api import convert as convert
from unlidar.api import evaluate as evaluate
from unlidar.api import run as run
from unlidar.engine import Engine as Engine
from unlidar.engine import Frame as Frame
from unlidar.engine import Frames as Frames
from unlidar.engine import Kind as Kind
from unlidar.engine import Track as Track
from unlidar.engine import track as track
from unlidar.errors import ConfigError as ConfigError
from unlidar.errors import InputError as InputError
from unlidar.errors import OutputError as OutputError
from unlidar.errors import ProgramError as ProgramError
from unlidar.errors import UnlidarError as UnlidarError
from unlidar.errors import UsageError as UsageError
from unlidar.events.event import EngineState as EngineState
from unlidar.events.event import Event as Event
from unlidar.events.event import Now as Now
from unlidar.events.event import Row as Row
from unlidar.events.event import SensorState as SensorState
from unlidar.events.event import TrackBegins as TrackBegins
from unlidar.events.event import TrackEnds as TrackEnds
from unlidar.geodesy import Origin as Origin
from unlidar.poses import Poses as Poses
from unlidar.reading import read as read

__version__: str
