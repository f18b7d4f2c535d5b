"""A job that leaves every door open to others: sockets, pipes, shared memory, files; it says where they are."""

import ctypes
import json
import os
import socket
import sys
import threading
import time
from pathlib import Path

KEY = int(sys.argv[1])
OUTPUT = Path(os.environ["ROBOMAKER_OUTPUT_DIR"])


def greet(server: socket.socket) -> None:
    while True:
        with server.accept()[0] as client:
            client.sendall(b"hi")


def answer(server: socket.socket) -> None:
    while True:
        _, who = server.recvfrom(100)
        if who:
            server.sendto(b"hi", who)


def listening(family: int, address: tuple[str, int] | str) -> socket.socket:
    server = socket.socket(family)
    server.bind(address)
    server.listen()
    threading.Thread(target=greet, args=[server], daemon=True).start()
    return server


tcp = listening(socket.AF_INET, ("127.0.0.1", 0))
six = listening(socket.AF_INET6, ("::1", 0))
abstract = listening(socket.AF_UNIX, f"\0neighbour-{KEY}")
os.chdir(OUTPUT)  # paths of sockets are short
in_output = listening(socket.AF_UNIX, "door.sock")
in_tmp = listening(socket.AF_UNIX, f"/tmp/{KEY}.sock")
udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
udp.bind(("127.0.0.1", 0))
threading.Thread(target=answer, args=[udp], daemon=True).start()
os.mkfifo("pipe")
threading.Thread(target=lambda: os.open("pipe", os.O_RDWR), daemon=True).start()
ctypes.CDLL(None).shmget(KEY, 4096, 0o1666)
shared = Path(f"/dev/shm/{KEY}")
shared.write_text("s3cret")
Path(f"/tmp/{KEY}").write_text("s3cret")
Path("secret.txt").write_text("s3cret")
places = {
    "tcp": tcp.getsockname()[1],
    "tcp of version 6": six.getsockname()[1],
    "udp": udp.getsockname()[1],
    "abstract socket": f"neighbour-{KEY}",
    "socket": f"/tmp/{KEY}.sock",
    "socket of outputs": str(OUTPUT / "door.sock"),
    "pipe": str(OUTPUT / "pipe"),
    "shared memory": str(shared),
    "shared memory of System V": KEY,
    "temporary files": f"/tmp/{KEY}",
    "other output": str(OUTPUT / "secret.txt"),
    "input": str(OUTPUT / "planted"),
}
Path("places.part").write_text(json.dumps(places))
Path("places.part").rename("places.json")
time.sleep(600)
