"""What a station says of itself when it registers."""

from sapient_msg.bsi_flex_335_v2_0 import location_pb2, velocity_pb2
from sapient_msg.bsi_flex_335_v2_0.registration_pb2 import Registration

from unlidar import __version__

ICD_VERSION = "BSI Flex 335 v2.0"
STATUS_EVERY_S = 5.0
MODE = "Default"
TRACK_NUMBER = "track"  # the engine's number, as other outputs of the relay have it
REQUESTS = ("Registration", "Reset", "Status")
# Classes of the standard's taxonomy, each with a subclass at level 1.
DRONE = "Air Vehicle", "UAV Rotary Wing"
BIRD = "Animal", "Bird"
UNKNOWN = "Unknown"
SUBCLASS_LEVEL = 1

_WARM_UP_S = 3.0
_PROBABILITY = "probability"


def registration(station: str) -> Registration:
    """A static LiDAR that tracks drones and takes no other task than to tell of itself."""
    place = Registration.LocationType(
        location_units=location_pb2.LOCATION_COORDINATE_SYSTEM_LAT_LNG_DEG_M,
        location_datum=location_pb2.LOCATION_DATUM_WGS84_E,
    )
    return Registration(
        node_definition=[Registration.NodeDefinition(node_type=Registration.NODE_TYPE_LIDAR)],
        icd_version=ICD_VERSION,
        name=f"unlidar_track at {station}",
        short_name=station,
        capabilities=[
            Registration.Capability(category="LiDAR", type="Tracks drones in three dimensions")
        ],
        status_definition=Registration.StatusDefinition(
            status_interval=_seconds(STATUS_EVERY_S),
            location_definition=place,
            status_report=[
                Registration.StatusReport(
                    category=Registration.STATUS_REPORT_CATEGORY_STATUS,
                    type="State of LiDARs and engine",
                    on_change=True,
                )
            ],
        ),
        mode_definition=[
            Registration.ModeDefinition(
                mode_name=MODE,
                mode_type=Registration.MODE_TYPE_PERMANENT,
                settle_time=_seconds(_WARM_UP_S),
                scan_type=Registration.SCAN_TYPE_FIXED,
                tracking_type=Registration.TRACKING_TYPE_TRACKLET,
                detection_definition=[_detections(place)],
                task=_tasks(place),
            )
        ],
        config_data=[
            Registration.ConfigurationData(
                manufacturer="unlidar_track", model="unlidar relay", software_version=__version__
            )
        ],
    )


def _detections(place: Registration.LocationType) -> Registration.DetectionDefinition:
    return Registration.DetectionDefinition(
        location_type=place,
        velocity_type=Registration.VelocityType(
            enu_velocity_units=velocity_pb2.ENUVelocityUnits(
                east_north_rate_units=velocity_pb2.SPEED_UNITS_MS,
                up_rate_units=velocity_pb2.SPEED_UNITS_MS,
            ),
            location_datum=location_pb2.LOCATION_DATUM_WGS84_E,
        ),
        geometric_error=Registration.GeometricError(
            type="Standard Deviation",
            units="x and y in degrees, z in metres",
            variation_type="told with each detection",
        ),
        detection_report=[
            Registration.DetectionReport(
                category=Registration.DETECTION_REPORT_CATEGORY_TRACK,
                type=TRACK_NUMBER,
                units="whole number",
            )
        ],
        detection_class_definition=[
            Registration.DetectionClassDefinition(
                confidence_definition=Registration.CONFIDENCE_DEFINITION_MULTI_CLASS,
                class_definition=[
                    *(_class(*names) for names in (DRONE, BIRD)),
                    Registration.ClassDefinition(type=UNKNOWN, units=_PROBABILITY),
                ],
            )
        ],
    )


def _class(name: str, subclass: str) -> Registration.ClassDefinition:
    of = Registration.SubClass(type=subclass, units=_PROBABILITY, level=SUBCLASS_LEVEL)
    return Registration.ClassDefinition(type=name, units=_PROBABILITY, sub_class=[of])


def _tasks(place: Registration.LocationType) -> Registration.TaskDefinition:
    return Registration.TaskDefinition(
        concurrent_tasks=1,
        # The standard asks for a region; tasks with one are rejected.
        region_definition=Registration.RegionDefinition(
            region_type=[Registration.REGION_TYPE_AREA_OF_INTEREST], region_area=[place]
        ),
        command=[
            Registration.Command(
                type=Registration.COMMAND_TYPE_REQUEST,
                units=", ".join(REQUESTS),
                completion_time=_seconds(1.0),
            )
        ],
    )


def _seconds(value: float) -> Registration.Duration:
    return Registration.Duration(units=Registration.TIME_UNITS_SECONDS, value=value)
