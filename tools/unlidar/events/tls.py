"""TLS: trust store and client certificate."""

import ssl

from unlidar.errors import ConfigError, reason
from unlidar.events.site import Output, Tls


def tls_context(files: Output | Tls, shown: str) -> ssl.SSLContext:
    """A context with Python's defaults: server name and certificate are verified.

    ConfigError with the displayed address if a file cannot be read.
    """
    try:
        context = ssl.create_default_context(cafile=files.ca_file)
        if files.certificate_file is not None:
            context.load_cert_chain(files.certificate_file, files.key_file)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{shown}: certificate or key: {reason(error)}") from error
    return context
