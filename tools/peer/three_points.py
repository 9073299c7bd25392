"""Draws frames with three.js in headless Chromium, of points that a page fetches."""

import base64
import http.server
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from scene import FOV, eye, points, words

scan, width, height, frames, picture, _ = words()
if not shutil.which("chromium"):
    sys.exit("chromium is not here")
library = Path(os.environ["NODE_PATH"]) / "three"
if not library.exists():
    sys.exit("three is not here; tools/peers --setup installs it")
xyz, rgb, diagonal = points(scan)
eyes = [eye(diagonal, frame) for frame in range(frames + 2)]
PAGE = """<!doctype html><body style="margin:0"><script type="module">
import * as THREE from "/three/build/three.module.js";
const bytes = async (name) => await (await fetch(name)).arrayBuffer();
const settings = %s;
const geometry = new THREE.BufferGeometry();
geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(await bytes("/xyz")), 3));
geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(await bytes("/rgb")), 3, true));
const material = new THREE.PointsMaterial({ size: 1, sizeAttenuation: false, vertexColors: true });
const scene = new THREE.Scene();
scene.background = new THREE.Color(0xff00ff);
const cloud = new THREE.Points(geometry, material);
cloud.frustumCulled = false;
scene.add(cloud);
const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
renderer.setSize(settings.width, settings.height);
document.body.appendChild(renderer.domElement);
const camera = new THREE.PerspectiveCamera(
  settings.fov, settings.width / settings.height, settings.diagonal / 1e3, settings.diagonal * 3);
camera.up.set(0, 0, 1);
const gl = renderer.getContext();
const pixel = new Uint8Array(4);
const seconds = [];
for (const eye of settings.eyes) {
  camera.position.set(...eye);
  camera.lookAt(0, 0, 0);
  const start = performance.now();
  renderer.render(scene, camera);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  seconds.push((performance.now() - start) / 1000);
}
const picture = renderer.domElement.toDataURL("image/png").split(",")[1];
await fetch("/result", { method: "POST", body: JSON.stringify(
  { seconds, picture, points: geometry.attributes.position.count, version: THREE.REVISION }) });
</script>""" % json.dumps(dict(width=width, height=height, fov=FOV, diagonal=diagonal, eyes=eyes))
answer, arrived = {}, threading.Event()


class Handler(http.server.BaseHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def reply(self, body, kind):
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self):
        if self.path == "/":
            self.reply(PAGE.encode(), "text/html")
        elif self.path == "/xyz":
            self.reply(xyz.tobytes(), "application/octet-stream")
        elif self.path == "/rgb":
            self.reply(rgb.tobytes(), "application/octet-stream")
        elif self.path.startswith("/three/build/") and ".." not in self.path:
            self.reply((library / self.path[len("/three/"):]).read_bytes(), "text/javascript")
        else:
            self.send_error(404)

    def do_POST(self):
        answer.update(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.reply(b"", "text/plain")
        arrived.set()


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
threading.Thread(target=server.serve_forever, daemon=True).start()
with tempfile.TemporaryDirectory() as profile:
    browser = subprocess.Popen(
        ["chromium", "--headless=new", "--no-sandbox", "--no-first-run", f"--user-data-dir={profile}",
         "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
         f"http://127.0.0.1:{server.server_port}/"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    found = arrived.wait(900)
    browser.terminate()
    browser.wait()
if not found:
    sys.exit("the page did not answer within 15 minutes")
Path(picture).write_bytes(base64.b64decode(answer["picture"]))
print(json.dumps(dict(version=f"r{answer['version']}", points=answer["points"],
                      seconds_of_frames=answer["seconds"][2:])))
