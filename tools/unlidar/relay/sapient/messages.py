"""Messages of a node: status, detections, alerts."""

import math
from collections.abc import Sequence

import numpy as np
from sapient_msg.bsi_flex_335_v2_0.alert_pb2 import Alert as AlertMessage
from sapient_msg.bsi_flex_335_v2_0.associated_detection_pb2 import AssociatedDetection
from sapient_msg.bsi_flex_335_v2_0.detection_report_pb2 import DetectionReport
from sapient_msg.bsi_flex_335_v2_0.location_pb2 import (
    LOCATION_COORDINATE_SYSTEM_LAT_LNG_DEG_M,
    LOCATION_DATUM_WGS84_E,
    Location,
)
from sapient_msg.bsi_flex_335_v2_0.status_report_pb2 import StatusReport
from sapient_msg.bsi_flex_335_v2_0.velocity_pb2 import ENUVelocity

from unlidar.events.event import Now
from unlidar.events.site import Place as SitePlace
from unlidar.events.station import Place
from unlidar.geodesy import metres_per_degree, to_east_north_up, to_geodetic
from unlidar.relay.sapient.ids import new_ulid
from unlidar.relay.sapient.picture import Alert, Health, Track
from unlidar.relay.sapient.registration import (
    BIRD,
    DRONE,
    MODE,
    SUBCLASS_LEVEL,
    TRACK_NUMBER,
    UNKNOWN,
)
from unlidar.sanitize import printable

LOST = "lost"
_ACCELERATION_MPS2 = 3.0  # 1-sigma of a drone, while its position is predicted
_UNSEEN_S = 10.0  # after which the engine gives a track up
_LEAST_CONFIDENCE = 0.01
_MOST_DEGREES = 180.0  # of an error, at the poles

_Class = DetectionReport.DetectionReportClassification
_SubClass = DetectionReport.SubClass


class Reporter:
    """Makes the messages of a station at a place."""

    def __init__(self, node_id: str, place: SitePlace) -> None:
        self._node_id = node_id
        self._origin = place.origin()
        self._north_m, self._east_m = metres_per_degree(self._origin)
        self._turn = to_east_north_up(self._origin, np.eye(3)).T

    def status(self, health: Health, is_new: bool) -> StatusReport:
        """How the station is."""
        origin = self._origin
        here = origin.latitude_deg, origin.longitude_deg, origin.height_m
        return StatusReport(
            report_id=new_ulid(),
            system=health.system,
            info=StatusReport.INFO_NEW if is_new else StatusReport.INFO_UNCHANGED,
            mode=MODE,
            node_location=_location(here),
            status=[
                StatusReport.Status(
                    status_level=told.level, status_type=told.kind, status_value=told.text
                )
                for told in health.told
            ],
        )

    def goodbye(self) -> StatusReport:
        """The last message before the connection is closed."""
        return StatusReport(
            report_id=new_ulid(),
            system=StatusReport.SYSTEM_GOODBYE,
            info=StatusReport.INFO_NEW,
            mode=MODE,
        )

    def detections(self, tracks: Sequence[Track], now_s: float) -> list[DetectionReport]:
        """Where the tracks are now, by their states and velocities."""
        if not tracks:
            return []
        ages_s = np.array([track.age_s(now_s) for track in tracks])
        return self._reports(tracks, ages_s)

    def lost(self, tracks: Sequence[Track]) -> list[DetectionReport]:
        """Where the tracks were last, as they have ended."""
        reports = self._reports(tracks, np.zeros(len(tracks))) if tracks else []
        for report in reports:
            report.state = LOST
        return reports

    def alert(self, alert: Alert) -> AlertMessage:
        """An alarm of a zone."""
        alarm = alert.alarm
        active = alert.is_active
        return AlertMessage(
            alert_id=alert.alert_id,
            alert_type=AlertMessage.ALERT_TYPE_WARNING,
            status=AlertMessage.ALERT_STATUS_ACTIVE if active else AlertMessage.ALERT_STATUS_CLEAR,
            description=printable(f"track {alarm.track} in {alarm.zone}"),
            location=None if alert.place is None else _location(alert.place),
            priority=AlertMessage.DISCRETE_PRIORITY_HIGH,
            confidence=alarm.row.drone,
            associated_detection=[
                AssociatedDetection(node_id=self._node_id, object_id=alert.object_id)
            ],
        )

    def _reports(self, tracks: Sequence[Track], ages_s: np.ndarray) -> list[DetectionReport]:
        states = [track.state for track in tracks]
        velocity_mps = np.array([(s.vx, s.vy, s.vz) for s in states])
        xyz_m = np.array([(s.x, s.y, s.z) for s in states]) + ages_s[:, None] * velocity_mps
        sigma_m = np.array([(s.sigma_x, s.sigma_y, s.sigma_z) for s in states])
        turned_m2 = sigma_m**2 @ self._turn.T**2  # variances along east, north, up
        predicted_m = 0.5 * _ACCELERATION_MPS2 * ages_s**2
        errors_m = np.sqrt(turned_m2 + predicted_m[:, None] ** 2)
        places = to_geodetic(self._origin, xyz_m)
        enu_mps = velocity_mps @ self._turn.T
        return [
            DetectionReport(
                report_id=new_ulid(),
                object_id=track.object_id,
                location=self._with_errors(_location(tuple(place)), error_m),
                detection_confidence=_confidence(track),
                track_info=[
                    DetectionReport.TrackObjectInfo(type=TRACK_NUMBER, value=str(track.number))
                ],
                classification=_classes(track),
                enu_velocity=ENUVelocity(east_rate=enu[0], north_rate=enu[1], up_rate=enu[2]),
            )
            for track, place, error_m, enu in zip(tracks, places, errors_m, enu_mps, strict=True)
        ]

    def _with_errors(self, location: Location, error_m: np.ndarray) -> Location:
        """Standard deviations in the coordinates' own units: degrees, degrees, metres."""
        east_m, north_m, up_m = error_m.tolist()
        # A degree of longitude spans nothing at the poles.
        least_m = east_m / _MOST_DEGREES
        location.x_error = east_m / max(self._east_m, least_m) if east_m else 0.0
        location.y_error = min(north_m / self._north_m, _MOST_DEGREES)
        location.z_error = up_m
        return location


def _location(place: Place) -> Location:
    lat, lon, height = place
    return Location(
        x=math.remainder(lon, 360.0),
        y=lat,
        z=height,
        coordinate_system=LOCATION_COORDINATE_SYSTEM_LAT_LNG_DEG_M,
        datum=LOCATION_DATUM_WGS84_E,
    )


def _confidence(track: Track) -> float:
    """That it is there: 1 while it is seen, less while it is not."""
    unseen_s = track.state.unseen_s if isinstance(track.state, Now) else 0.0
    return max(_LEAST_CONFIDENCE, 1.0 - unseen_s / _UNSEEN_S)


def _classes(track: Track) -> list[_Class]:
    if track.drone is None:
        return []
    bird = track.bird_like or 0.0
    return [
        _class(DRONE, track.drone),
        _class(BIRD, bird),
        _Class(type=UNKNOWN, confidence=max(0.0, 1.0 - track.drone - bird)),
    ]


def _class(names: tuple[str, str], probability: float) -> _Class:
    sub = _SubClass(type=names[1], confidence=probability, level=SUBCLASS_LEVEL)
    return _Class(type=names[0], confidence=probability, sub_class=[sub])
