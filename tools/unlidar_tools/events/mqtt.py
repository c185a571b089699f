"""How a broker is called, to listen as well as to publish."""

import ssl

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

KEEPALIVE_S = 15  # half as much again, and a broker tells a last will

Login = tuple[str, str | None]  # user, password


def make_client(login: Login | None, tls: ssl.SSLContext | None) -> paho.Client:
    """Not connected yet; who called it sees that it is connected again."""
    client = paho.Client(CallbackAPIVersion.VERSION2, reconnect_on_failure=False)
    if login is not None:
        client.username_pw_set(*login)
    if tls is not None:
        client.tls_set_context(tls)
    return client
