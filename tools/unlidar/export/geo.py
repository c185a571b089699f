"""Trajectories on a map: KML for Google Earth, GeoJSON for QGIS and web maps."""

import json
from pathlib import Path
from xml.etree import ElementTree as Xml

from unlidar.export.dates import utc
from unlidar.export.text import place_digits
from unlidar.export.trajectory import Result, Track
from unlidar.geodesy import Origin, to_geodetic
from unlidar.output import write_file
from unlidar.sanitize import printable

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"


def write_kml(result: Result, out: Path, origin: Origin) -> list[Path]:
    """A gx:Track for each track: with times, so that Google Earth can play it."""
    Xml.register_namespace("", _KML)
    Xml.register_namespace("gx", _GX)
    root = Xml.Element(f"{{{_KML}}}kml")
    document = _add(root, _KML, "Document")
    _add(document, _KML, "name", printable(result.name))
    for track in result.by_track:
        place = _add(document, _KML, "Placemark")
        _add(place, _KML, "name", f"track {track.track_id}")
        line = _add(place, _GX, "Track")
        _add(line, _KML, "altitudeMode", "absolute")
        for stamp in track.stamp_ns:
            _add(line, _KML, "when", utc(stamp))
        for lat, lon, height in _places(track, origin):
            _add(line, _GX, "coord", f"{lon} {lat} {height}")
    Xml.indent(root)
    tree = Xml.ElementTree(root)
    write_file(out, lambda work: tree.write(work, encoding="utf-8", xml_declaration=True))
    return [out]


def write_geojson(result: Result, out: Path, origin: Origin) -> list[Path]:
    """RFC 7946: a LineString for each track (a Point for one row), per-row values as properties."""
    features = [_feature(track, origin) for track in result.by_track]
    text = json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"
    write_file(out, lambda work: work.write_text(text))
    return [out]


def _feature(track: Track, origin: Origin) -> dict:
    line = [[float(lon), float(lat), float(h)] for lat, lon, h in _places(track, origin)]
    properties: dict = {
        "track_id": track.track_id,
        "times": [utc(stamp) for stamp in track.stamp_ns],
    }
    columns = {
        "velocity_mps": track.velocity_mps,
        "sigma_m": track.sigma_m,
        "support": track.support,
    }
    properties |= {name: v.tolist() for name, v in columns.items() if v is not None}
    single = len(line) == 1
    return {
        "type": "Feature",
        "geometry": {
            "type": "Point" if single else "LineString",
            "coordinates": line[0] if single else line,
        },
        "properties": properties,
    }


def _places(track: Track, origin: Origin) -> list[list[str]]:
    return [place_digits(place) for place in to_geodetic(origin, track.xyz_m)]


def _add(parent: Xml.Element, space: str, tag: str, text: str | None = None) -> Xml.Element:
    element = Xml.SubElement(parent, f"{{{space}}}{tag}")
    element.text = text
    return element
