"""MQTT client settings shared by subscriber and publisher."""

import ssl

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

KEEPALIVE_S = 15  # a broker publishes the last will after 1.5 times this

Login = tuple[str, str | None]  # user, password


def make_client(login: Login | None, tls: ssl.SSLContext | None) -> paho.Client:
    """A client, not yet connected; reconnection is up to the caller."""
    client = paho.Client(CallbackAPIVersion.VERSION2, reconnect_on_failure=False)
    if login is not None:
        client.username_pw_set(*login)
    if tls is not None:
        client.tls_set_context(tls)
    return client
