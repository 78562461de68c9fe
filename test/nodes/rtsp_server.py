"""An RTSP server on the loopback device that sends a folder of JPEG pictures as H.264, again and again.

    /usr/bin/python3 rtsp_server.py FOLDER PORT FPS [USER:PASSWORD]

For the Python that has the bindings of GStreamer: apt install gir1.2-gst-rtsp-server-1.0 python3-gi
gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly. Prints ``ready`` once it can be asked.
"""

import sys

import gi

gi.require_version('Gst', '1.0')
gi.require_version('GstRtspServer', '1.0')
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402 - only after the versions are chosen

PIPELINE = ('( multifilesrc location={folder}/%03d.jpg loop=true caps=image/jpeg,framerate={fps}/1 ! jpegdec '
            '! videoconvert ! x264enc tune=zerolatency speed-preset=ultrafast key-int-max=10 bitrate=4000 '
            '! rtph264pay name=pay0 pt=96 )')


def protect(server, factory, credentials):
    """Only who knows ``user:password`` gets the stream."""
    user, _, password = credentials.partition(':')
    auth = GstRtspServer.RTSPAuth()
    token = GstRtspServer.RTSPToken()
    token.set_string('media.factory.role', 'viewer')
    auth.add_basic(GstRtspServer.RTSPAuth.make_basic(user, password), token)
    server.set_auth(auth)
    permissions = GstRtspServer.RTSPPermissions()
    permissions.add_permission_for_role('viewer', 'media.factory.access', True)
    permissions.add_permission_for_role('viewer', 'media.factory.construct', True)
    factory.set_permissions(permissions)


def main():
    folder, port, fps = sys.argv[1:4]
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address('127.0.0.1')
    server.set_service(port)
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(PIPELINE.format(folder=folder, fps=fps))
    factory.set_shared(True)
    if len(sys.argv) > 4:
        protect(server, factory, sys.argv[4])
    server.get_mount_points().add_factory('/drone', factory)
    if not server.attach(None):
        sys.exit(f'port {port} cannot be had')
    print('ready', flush=True)
    GLib.MainLoop().run()


if __name__ == '__main__':
    main()
