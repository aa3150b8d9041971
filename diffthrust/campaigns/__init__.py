"""Campaigns: one task over many specs, in parallel, stopped and continued at will."""

from diffthrust.campaigns._campaign import Campaign as Campaign
from diffthrust.campaigns._campaign import campaign as campaign
