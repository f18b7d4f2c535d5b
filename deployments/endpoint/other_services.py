"""Error responses for AWS services that are not served here, in the protocol of the requested service.

SDKs in jobs are led here (`tasks.simulations.environment.aws_endpoints`), as their keys are valid here only.
"""

import re
from typing import Literal
from xml.sax.saxutils import escape

from starlette.responses import Response

from ...schemas.runs.variables import CALL_AWS, REFUSED
from .service_requests import ServiceRequest
from .wire import error_response

Protocol = Literal["json", "query", "ec2", "rest-xml"]

_SIGNED_FOR = re.compile(r"Credential=[^/,\s]+/\d{8}/[^/,\s]*/([a-z0-9-]{1,63})/aws4_request")
_XML_SERVICES = frozenset({"s3", "s3express", "s3-outposts", "cloudfront", "route53"})
"""AWS services whose REST protocol is XML; all others use JSON."""
_STATUS = 403  # no SDK tries again after it
_CODES = {"json": "AccessDeniedException", "query": "AccessDenied", "ec2": "UnauthorizedOperation"}
_XML = {
    "query": "<ErrorResponse>{error}<RequestId>{id}</RequestId></ErrorResponse>",
    "rest-xml": "{error}",
    "ec2": "<Response><Errors>{error}</Errors><RequestID>{id}</RequestID></Response>",
}


def refused(request: ServiceRequest) -> Response | None:
    """Returns the error response if a request is meant for another AWS service; `None` for RoboMaker.

    Args:
        request: The request, of any caller: the response contains only what the documentation has.
    """
    if not f"{request.raw_path}/".startswith(f"{REFUSED}/"):
        return None
    found = _SIGNED_FOR.search(request.headers.get("authorization", ""))
    service = found[1] if found else ""
    protocol = _protocol(request, service)
    return _answer(protocol, _said(service), request.id)


def _protocol(request: ServiceRequest, service: str) -> Protocol:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == "application/x-www-form-urlencoded":
        return "ec2" if service == "ec2" else "query"
    return "rest-xml" if service in _XML_SERVICES else "json"


def _said(service: str) -> str:
    name = f"the service {service} of AWS" if service else "a service of AWS"
    text = (
        f"{name} is not served here, and a job whose keys are good here only does not call AWS: give the job keys of "
        f"its own in environmentVariables, or set {CALL_AWS}=1 where jobs are performed"
    )
    if service.startswith("s3"):
        text += "; S3 is served to jobs where ROBOMAKER_OBJECT_STORE is an S3 server"
    return text


def _answer(protocol: Protocol, message: str, request_id: str) -> Response:
    code = _CODES.get(protocol, "AccessDenied")
    if protocol == "json":
        return error_response(code, _STATUS, message)
    error = f"<Error><Type>Sender</Type><Code>{code}</Code><Message>{escape(message)}</Message></Error>"
    content = '<?xml version="1.0" encoding="UTF-8"?>' + _XML[protocol].format(error=error, id=escape(request_id))
    return Response(content, _STATUS, {"x-amzn-errortype": code}, "text/xml")
