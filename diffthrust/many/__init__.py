"""Many logs of one model at once: each answered as if it were alone, compiled and run together."""

from diffthrust.many._calls import compare as compare
from diffthrust.many._calls import fit as fit
from diffthrust.many._calls import sample as sample
from diffthrust.many._maps import describing_function as describing_function
from diffthrust.many._result import Many as Many
