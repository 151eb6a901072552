"""The network around the service: one request is worked on at a time, what cannot be answered is refused by name."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from instdrive_core.errors import OptionError
from instdrive_core.serving.messages import SERVICE, list_methods, pack_message
from instdrive_core.serving.requests import RequestError, TooFastError
from instdrive_core.serving.service import SensorService

_LOG = logging.getLogger(__name__)


class SensorServer:
    """A running server; use it in a ``with``, which stops it.

    Args:
        service: what is answered.
        host: address to listen at.
        port: 0 takes a free one.

    Raises OptionError where the address cannot be taken, ModuleNotFoundError without grpcio.
    """

    def __init__(self, service: SensorService, host: str = "127.0.0.1", port: int = 0) -> None:
        import grpc

        limits = service.limits
        self._server = grpc.server(
            ThreadPoolExecutor(limits.requests, thread_name_prefix="serve"),
            options=[
                ("grpc.max_receive_message_length", limits.message_bytes),
                ("grpc.max_send_message_length", -1),
                ("grpc.so_reuseport", 0),
            ],
            maximum_concurrent_rpcs=limits.requests,
        )
        turn = threading.Lock()
        handlers = {
            name: grpc.unary_unary_rpc_method_handler(
                _build_handler(getattr(service, name), kinds[0], turn), None, pack_message
            )
            for name, kinds in list_methods().items()
        }
        self._server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(SERVICE, handlers),))
        shown = f"[{host}]" if ":" in host else host
        try:
            self.port = self._server.add_insecure_port(f"{shown}:{port}")
        except RuntimeError:
            self.port = 0
        if not self.port:
            raise OptionError(f"{shown}:{port} cannot be listened at: it is taken or not ours; choose another --port")
        self.address = f"{shown}:{self.port}"
        self._server.start()

    def __enter__(self) -> SensorServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self, grace: float = 5.0) -> None:
        """Take no more requests, and end once those in flight are answered, or after `grace` seconds."""
        self._server.stop(grace).wait()


def _build_handler(answer: Callable[[Any], Any], kind: Any, turn: threading.Lock) -> Callable[[bytes, Any], Any]:
    """What gRPC calls: bytes that are no message, and messages that ask for the impossible, are the client's fault."""
    import grpc
    from google.protobuf.message import DecodeError

    def handle(sent: bytes, context: Any) -> Any:
        try:
            request = kind.FromString(sent)
            with turn:
                if not context.is_active():
                    context.abort(grpc.StatusCode.CANCELLED, "nobody waits for the answer any longer")
                return answer(request)
        except DecodeError:
            problem = f"the request is {len(sent)} bytes that are no {kind.DESCRIPTOR.name}; send that message"
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, problem)
        except RequestError as error:
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error))
        except TooFastError as error:
            context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, str(error))
        except MemoryError:
            problem = "the server has not the memory for this request; ask for smaller pictures"
            context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, problem)
        except Exception as error:
            if context.code() is not None:  # abort() above
                raise
            _LOG.exception("a request failed")
            context.abort(grpc.StatusCode.INTERNAL, f"the server failed ({type(error).__name__}); its log says why")

    return handle
