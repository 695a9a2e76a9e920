# SPDX-License-Identifier: Apache-2.0
"""How the daemon ends and what signals do: end_test.py KDRAYD [TEST]

S10 of the scenarios in tests/README.md.
"""
import http.client
import json
import os
import signal
import socket
import sys
import threading
import time
import unittest

from service import Service, bumpy, rays

KDRAYD = sys.argv[1]
ROUNDS = int(os.environ.get("KDRAY_ROUNDS", "3"))


class Load(threading.Thread):
    """Sends batches until the server says that it ends, over kept connections or new ones. Whatever
    comes back instead of an answer is in `broken`."""

    def __init__(self, service, keeps, pause):
        super().__init__(daemon=True)
        self.service, self.keeps, self.pause = service, keeps, pause
        self.answers, self.refused, self.broken = 0, 0, []

    def run(self):
        body, path = rays(200), self.service.tree + "/rays/closest"
        connection = self.service.connect()
        while True:
            try:
                if connection.sock is None:
                    connection.connect()
            except OSError:
                return  # the daemon no longer listens
            try:
                connection.request("POST", path, body)
                answer = connection.getresponse()
                content = answer.read()
            except (http.client.HTTPException, OSError) as error:
                self.broken.append(repr(error))
                return
            if answer.status == 200:
                self.answers += 1
            elif answer.status == 503 and json.loads(content)["code"] == "draining":
                self.refused += 1
                return
            else:
                self.broken.append(f"{answer.status} {content[:200]}")
            if not self.keeps:
                connection.close()
            time.sleep(self.pause)


class EndTest(unittest.TestCase):
    def test_S10_no_request_is_cut_when_the_daemon_ends_under_load(self):
        for _ in range(ROUNDS):
            with Service(KDRAYD) as service:
                service.upload(bumpy(20))
                load = [Load(service, keeps, pause) for keeps in (True, False)
                        for pause in (0, 0.003, 0.1) for _ in range(4)]
                for client in load:
                    client.start()
                time.sleep(0.5)  # real time: under load
                start = time.monotonic()
                self.assertEqual(service.stop(), 0)
                self.assertLess(time.monotonic() - start, 5)
                for client in load:
                    client.join(30)
                self.assertEqual([error for client in load for error in client.broken], [])
                self.assertGreater(sum(client.answers for client in load), 50)

    def test_S10_a_request_under_way_ends_although_its_client_is_slow(self):
        with Service(KDRAYD) as service:
            service.upload(bumpy(20))
            body = rays(2000)
            with service.socket() as client:
                head = f"POST {service.tree}/rays/any HTTP/1.1\r\nHost: h\r\nContent-Length: {len(body)}\r\n\r\n"
                client.sendall(head.encode() + body[:1000])
                time.sleep(0.1)  # real time: the daemon reads the body when it is told to end
                service.process.send_signal(signal.SIGTERM)
                time.sleep(0.5)
                self.assertIsNone(service.process.poll())
                client.sendall(body[1000:])
                answer = http.client.HTTPResponse(client)
                answer.begin()
                self.assertEqual(answer.status, 200)
                self.assertEqual(answer.getheader("Connection"), "close")
                answer.read()
            self.assertEqual(service.process.wait(10), 0)

    def test_S10_work_that_lasts_too_long_is_cancelled_and_answered(self):
        with Service(KDRAYD, "--drain-timeout-ms", "300") as service:
            service.upload(bumpy(20))
            connection = service.connect()
            connection.request("GET", service.tree + "/render.png?width=4000&height=4000&samples=1024"
                               "&mode=ambient-occlusion&deadline_ms=60000")
            time.sleep(0.3)  # real time: until the picture is under way
            start = time.monotonic()
            self.assertEqual(service.stop(), 0)
            self.assertLess(time.monotonic() - start, 4)
            answer = connection.getresponse()
            self.assertEqual((answer.status, json.loads(answer.read())["code"]), (503, "draining"))
            connection.close()

    def test_a_second_signal_ends_the_wait(self):
        with Service(KDRAYD) as service:
            service.upload(bumpy(20))
            connection = service.connect()
            connection.request("GET", service.tree + "/render.png?width=4000&height=4000&samples=1024"
                               "&mode=ambient-occlusion&deadline_ms=60000")
            time.sleep(0.3)  # real time: until the picture is under way
            service.process.send_signal(signal.SIGTERM)
            time.sleep(0.3)
            self.assertIsNone(service.process.poll())
            start = time.monotonic()
            self.assertEqual(service.stop(), 0)
            self.assertLess(time.monotonic() - start, 4)
            connection.close()

    def test_SIGHUP_reads_the_tokens_again_and_ends_nothing(self):
        def status(service, token):
            return service.ask("GET", "/v1", headers={"Authorization": "Bearer " + token})[0]

        with Service(KDRAYD) as plain:
            plain.process.send_signal(signal.SIGHUP)
            time.sleep(0.1)
            self.assertEqual(plain.ask("GET", "/v1")[0], 200)
            path = os.path.join(plain.folder, "tokens")
            with open(path, "w", encoding="ascii") as file:
                file.write("first\n")
            with Service(KDRAYD, "--token-file", path) as service:
                self.assertEqual([status(service, "first"), status(service, "second")], [200, 401])
                for text, first, second, event in (("second\n", 401, 200, "reloaded"),
                                                   ("\n", 401, 200, "reload_failed"),
                                                   ("first\nsecond\n", 200, 200, "reloaded")):
                    with open(path, "w", encoding="ascii") as file:
                        file.write(text)
                    before = len(service.log())
                    service.process.send_signal(signal.SIGHUP)
                    deadline = time.monotonic() + 5
                    while event not in [line["event"] for line in service.log()[before:]]:
                        self.assertLess(time.monotonic(), deadline)
                        time.sleep(0.02)
                    self.assertEqual([status(service, "first"), status(service, "second")],
                                     [first, second])
                self.assertEqual(service.stop(), 0)

    def test_the_log_has_a_level_trace_ids_and_queries_without_secrets(self):
        trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
        with Service(KDRAYD) as service:
            service.ask("GET", "/v1?token=hush", headers={"traceparent": trace, "X-Request-Id": "one"})
            service.ask("GET", "/v1/trees?limit=7&hush&key=hush", headers={"X-Request-Id": "two"})
            self.assertEqual(service.stop(), 0)
            lines = {line.get("request_id"): line for line in service.log()}
            self.assertEqual(lines["one"]["trace_id"], trace[3:35])
            self.assertEqual(lines["one"]["parent_id"], trace[36:52])
            self.assertEqual(lines["two"]["query"], "limit=7&***&***")
            self.assertNotIn("trace_id", lines["two"])
            self.assertNotIn("hush", json.dumps(list(lines.values())))
        with Service(KDRAYD, "--log-level", "warning") as service:
            service.ask("GET", "/v1")
            self.assertEqual(service.stop(), 0)
            # A machine with few descriptors adds a warning that says so.
            self.assertEqual({line["event"] for line in service.log()} - {"fewer_connections"}, set())


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
