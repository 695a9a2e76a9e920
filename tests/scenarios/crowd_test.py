# SPDX-License-Identifier: Apache-2.0
"""Many connections, most of them bad: crowd_test.py KDRAYD [TEST]

S01 and S02 of the scenarios in tests/README.md. A good client asks small batches the whole time, and
the times of its answers are compared with those on a quiet daemon.
"""
import http.client
import json
import os
import socket
import sys
import time
import unittest

from service import Service, SlowClients, bumpy, percentile, rays

KDRAYD = sys.argv[1]
PART_OF_A_HEAD = b"GET /v1 HTTP/1.1\r\nHost: kdray\r\nX: "


def body_of(service, size):
    return (f"POST {service.tree}/rays/any HTTP/1.1\r\nHost: kdray\r\nContent-Length: {size}\r\n\r\n"
            '{"rays":[').encode()


def picture_of(service):
    return (f"GET {service.tree}/render.npy?mode=depth&width=2000&height=1000 HTTP/1.1\r\n"
            "Host: kdray\r\n\r\n").encode()


class CrowdTest(unittest.TestCase):
    def good_times(self, service, seconds, new_connections=False):
        """Seconds of each answer to a good client. Every answer must be right."""
        body, connection, times = rays(), service.connect(), []
        path = service.tree + "/rays/closest"
        expected, refused = None, 0
        while expected is None or expected[0] != 200:
            self.assertTrue(expected is None or expected[0] == 503, expected)
            expected = service.ask("POST", path, body)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            start = time.perf_counter()
            for attempt in range(4):
                try:
                    got = service.ask("POST", path, body, connection=connection)
                    break
                except (http.client.RemoteDisconnected, ConnectionError):
                    # It was idle when another one needed room. It begins again, as browsers do.
                    connection.close()
                    self.assertLess(attempt, 3)
            if got[0] == 503:  # all others were newer than a moment
                refused += 1
                connection.close()
                continue
            self.assertEqual(got, expected)
            times.append(time.perf_counter() - start)
            if new_connections:
                connection.close()
            time.sleep(0.002)
        connection.close()
        self.assertLessEqual(refused, 1 + len(times) // 20)
        return times

    def test_S01_four_hundred_idle_and_64_slow_clients_at_most_double_a_good_clients_p99(self):
        # What the scheduler of a machine with other load adds to single answers. A hiccup of the
        # machine may still hit one of the two: what holds in one of three rounds holds.
        rounds = []
        for _ in range(3):
            quiet, crowded = self.quiet_and_crowded()
            print(f"p50 and p99 of a good client: {percentile(quiet, .5) * 1e3:.2f} and "
                  f"{percentile(quiet, .99) * 1e3:.2f} ms; crowded: {percentile(crowded, .5) * 1e3:.2f} and "
                  f"{percentile(crowded, .99) * 1e3:.2f} ms")
            rounds.append(percentile(crowded, .99) - 2 * percentile(quiet, .99) - 0.001 * NOISE)
            if rounds[-1] <= 0:
                break
        self.assertLessEqual(min(rounds), 0)

    def quiet_and_crowded(self):
        """Times of a good client alone, and beside 464 idle and slow ones."""
        with Service(KDRAYD) as service:
            service.upload(bumpy(20))
            quiet = self.good_times(service, 1.5)
            with SlowClients(service.port, 400, b"") as idle, \
                    SlowClients(service.port, 16, PART_OF_A_HEAD, b"y") as heads, \
                    SlowClients(service.port, 16, body_of(service, 10_000), b"1") as bodies, \
                    SlowClients(service.port, 16, body_of(service, 10_000)) as silent, \
                    SlowClients(service.port, 16, picture_of(service), receive_buffer=4096) as readers:
                time.sleep(1)  # real time: until the pictures of the slow readers are made
                crowded = self.good_times(service, 1.5)
                self.assertEqual([c.opened >= c.count for c in (idle, heads, bodies, silent, readers)],
                                 [True] * 5)
        return quiet, crowded

    def check_good_client_beside(self, service, slow, new_connections):
        with slow:
            times = self.good_times(service, 2, new_connections)
        print(f"{len(times)} answers in 2 s, p50 {percentile(times, .5) * 1e3:.2f} ms, "
              f"p99 {percentile(times, .99) * 1e3:.2f} ms, most {max(times) * 1e3:.0f} ms")
        self.assertGreater(len(times), 60)
        self.assertLess(percentile(times, .5), 0.05)

    def test_S01_drips_of_heads_beyond_the_limit_leave_good_clients_their_service(self):
        for new_connections in (True, False):
            with Service(KDRAYD, "--max-connections", "200") as service:
                service.upload(bumpy(20))
                slow = SlowClients(service.port, 220, PART_OF_A_HEAD, b"y")
                self.check_good_client_beside(service, slow, new_connections)
                self.assertGreater(
                    service.metric('kdray_http_dropped_connections_total{reason="evicted"}'), 0)

    def test_S01_drips_of_bodies_at_the_limit_leave_good_clients_their_service(self):
        with Service(KDRAYD, "--max-connections", "100") as service:
            service.upload(bumpy(20))
            slow = SlowClients(service.port, 100, body_of(service, 10_000), b"1", pause=0.1)
            with slow:
                time.sleep(1)  # real time: until they are late
                times = self.good_times(service, 2, new_connections=True)
            self.assertGreater(len(times), 60)

    def test_S01_readers_that_do_not_read_leave_good_clients_their_service(self):
        with Service(KDRAYD, "--max-connections", "40") as service:
            service.upload(bumpy(20))
            with SlowClients(service.port, 40, picture_of(service), receive_buffer=4096):
                time.sleep(2)  # real time: until their pictures are made and they are late
                times = self.good_times(service, 2, new_connections=True)
            self.assertGreater(len(times), 60)

    def test_S02_a_daemon_with_few_descriptors_serves_as_many_connections_as_they_suffice_for(self):
        with Service(KDRAYD, "--max-connections", "1000", descriptors=(160, 160)) as service:
            service.upload(bumpy(20))
            with SlowClients(service.port, 60, b"", pause=0.3):
                times = self.good_times(service, 1, new_connections=True)
                self.assertLess(max(times), 1)
                status, _ = service.ask("POST", "/v1/trees?build=bvh", bumpy(21))
                self.assertEqual(status, 201)
            warnings = [line for line in service.log() if line["event"] == "fewer_connections"]
            self.assertEqual([line["connections"] for line in warnings], [32])

    def test_S02_the_soft_limit_of_descriptors_is_raised(self):
        with Service(KDRAYD, "--max-connections", "300", descriptors=(100, 1000)) as service:
            with SlowClients(service.port, 290, b""):
                self.assertEqual(service.ask("GET", "/healthz")[0], 200)
                self.assertGreater(service.process_figures()[1], 290)
            self.assertNotIn("fewer_connections", [line["event"] for line in service.log()])

    def test_S02_thousands_of_connections_leave_the_daemon_as_it_was(self):
        with Service(KDRAYD, "--max-connections", "100") as service:
            service.upload(bumpy(20))
            clients = []
            for _ in range(CONNECTIONS):
                try:
                    clients.append(service.socket(1))
                except OSError:
                    break
                if len(clients) >= 1000:
                    clients.pop(0).close()
            start = time.monotonic()
            self.assertEqual(service.ask("GET", "/healthz")[0], 200)
            self.assertLess(time.monotonic() - start, 1)
            for client in clients:
                client.close()
            deadline = time.monotonic() + 5
            while service.metric("kdray_http_connections") > 1 and time.monotonic() < deadline:
                time.sleep(0.05)
            self.assertLess(service.process_figures()[1], 40)
            self.assertEqual(service.stop(), 0)

    def test_a_client_that_sends_all_before_it_reads_sees_why_its_upload_is_refused(self):
        # http.client reads the answer after the last byte of the body.
        large = b"x" * (32 << 20)
        with Service(KDRAYD, "--max-upload", "1MiB", "--max-rays", "1000") as service:
            service.upload(bumpy(10))
            for path, code in (("/v1/trees", "mesh_too_large"),
                               ("/v1/trees/unknown/nothing", "not_found"),
                               (service.tree + "/rays/closest", "body_too_large")):
                for body in (large, iter([large[:100_000]] * 300)):
                    connection = service.connect()
                    connection.request("POST", path, body, encode_chunked=not isinstance(body, bytes),
                                       headers={} if isinstance(body, bytes)
                                       else {"Transfer-Encoding": "chunked"})
                    answer = connection.getresponse()
                    self.assertEqual(json.loads(answer.read())["code"], code, path)
                    connection.close()

    def test_http_1_0_is_told_whether_its_connection_is_kept(self):
        with Service(KDRAYD) as service:
            for header, says, is_kept in ((b"Connection: keep-alive\r\n", b"keep-alive", True),
                                          (b"", b"close", False)):
                with service.socket() as client:
                    for _ in range(2 if is_kept else 1):
                        client.sendall(b"GET /healthz HTTP/1.0\r\n" + header + b"\r\n")
                        answer = b""
                        while not answer.endswith(b'{"status":"ok"}'):
                            answer += client.recv(4096)
                        self.assertIn(b"\r\nConnection: " + says + b"\r\n", answer)
                    if not is_kept:
                        self.assertEqual(client.recv(1), b"")


CONNECTIONS = int(os.environ.get("KDRAY_CONNECTIONS", "3000"))
NOISE = float(os.environ.get("KDRAY_NOISE_MS", "5"))

if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
