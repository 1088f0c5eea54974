"""Which precision a device computes in: by rule, or as it is asked for."""

from vrte.basics.errors import DeviceError
from vrte.cl.device import Device
from vrte.request.how import OF_SINGLE


def choose_precision(asked: str, accuracy: float, device: Device) -> tuple[str, str]:
    """The precision that a device computes in, and why.

    Raises DeviceError where a device without doubles cannot give what is asked for.

    >>> card = Device("A", "card", "gpu", False, 8 << 30, 2 << 30, 40, "1")
    >>> choose_precision("auto", 1e-3, card)
    ('single', 'the device has no doubles')
    """
    if not device.double_precision and asked == "double":
        raise DeviceError(f"the OpenCL device {device.name} has no doubles, which precision {asked!r} needs")
    if asked != "auto":
        return asked, "asked for"
    if not device.double_precision:
        if accuracy < OF_SINGLE:
            raise DeviceError(
                f"the OpenCL device {device.name} has no doubles, and single precision is good for an accuracy of "
                f"{OF_SINGLE:g}, not {accuracy:g}: ask for accuracy={OF_SINGLE:g}, or take another device"
            )
        return "single", "the device has no doubles"
    return "double", "the device has doubles"
