"""Requests to servers, with a server of one answer."""

import http.server
import json
import threading
import unittest
from unittest import mock

import insula
from insula import _http


class OneAnswer(http.server.BaseHTTPRequestHandler):
    BODY = json.dumps({"name": "a", "title": "A"}).encode()

    def do_GET(self):
        self.send_response(200)
        self.send_header("content-length", str(len(self.BODY)))
        self.end_headers()
        self.wfile.write(self.BODY)

    def log_message(self, *_):
        pass


class Requests(unittest.TestCase):
    def setUp(self):
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), OneAnswer)
        self.port = server.server_address[1]
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        self.addCleanup(server.server_close)
        self.addCleanup(thread.join)
        self.addCleanup(server.shutdown)

    def address(self, rest: str) -> str:
        return f"http://me:s3cret@127.0.0.1:{self.port}/{rest}"

    def test_no_message_and_no_name_has_a_password_or_a_query(self):
        city = insula.open(self.address("cities/a"))
        self.assertEqual(repr(city), f"<City 'A' at http://127.0.0.1:{self.port}/v1/cities/a>")
        for place in (
            "http://me:s3cret@127.0.0.1:9/folder?key=s3cret",
            "ftp://me:s3cret@127.0.0.1/folder?key=s3cret",
            self.address("folder?key=s3cret and more"),
            "http://me:s3cret@[/folder",
        ):
            with self.assertRaises(insula.Error) as caught:
                insula.open(place)
            self.assertNotIn("s3cret", str(caught.exception))
        with self.assertRaises(insula.Error) as caught:
            city.attributes()
        self.assertNotIn("s3cret", str(caught.exception))
        self.assertEqual(_http.without_user(self.address("v1")), f"http://127.0.0.1:{self.port}/v1")

    def test_answers_have_a_longest_time_and_length(self):
        address = self.address("x")
        self.assertEqual(_http.get(address).body, OneAnswer.BODY)
        with mock.patch.object(_http, "_ANSWER_SECS", -1), self.assertRaisesRegex(insula.Error, "no answer: it takes"):
            _http.get(address)
        with mock.patch.object(_http, "_MAX_BYTES", 5), self.assertRaisesRegex(insula.Error, "longer than 5 bytes"):
            _http.get(address)


if __name__ == "__main__":
    unittest.main()
