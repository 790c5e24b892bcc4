"""What figures are called and how numbers are written for a reader. Owns words only."""

METRIC_NAMES = {
    "pairs": "pairs",
    "accuracy": "labels that a cut of r at 0.5 gets right",
    "auc": "AUC of reachability",
    "ece": "calibration error of r (ECE)",
    "position_median_m": "position error, median (m)",
    "position_p90_m": "position error, 90th percentile (m)",
    "position_median_1_to_1_5_m": "position error at 1 to 1.5 m, median (m)",
    "yaw_median_deg": "yaw error, median (degrees)",
    "yaw_p90_deg": "yaw error, 90th percentile (degrees)",
    "distance_sigma": "spread of d(predicted) - d(true)",
    "far_pairs": "far pairs",
    "near_pairs": "near pairs",
    "threshold_at_tpr60": "r that 60 % of the near pairs reach",
    "far_fpr_at_tpr60": "share of the far pairs that reach it too",
    "far_fpr_at_half": "share of the far pairs with r > 0.5",
    "near_tpr_at_half": "share of the near pairs with r > 0.5",
    "success_if_reachable": "p(success given reachable), driven edges",
    "success_if_not": "p(success given not reachable)",
    "parameters": "parameters of the network",
    "encode_ms": "time to encode an image (ms)",
    "pair_ms": "time to compare a pair (ms)",
}
"""What the card's figures are called; a figure without a name is called by its key."""

DRIVING_METRIC_NAMES = {
    "images": "images of the drive through each apartment",
    "arrival_if_reachable": "truly arrived, given reachable",
    "arrival_if_not": "truly arrived, given not reachable",
    "connected_if_not": "false edges the method would have made",
    "not_begun": "edges not driven, for the robot took itself to be elsewhere",
    "distance_sigma": "spread of d over pairs that become edges: sigma of Eq. 4",
    "distance_sigma_all": "the same over all reachable pairs",
}
"""Names of figures that only driving gives, or that mean something else there."""


def format_metric(number: object) -> str:
    """Write a figure of the card for a reader."""
    if isinstance(number, float):
        if number == 0:
            return "0"
        return f"{number:.1e}" if 0 < abs(number) < 1e-3 else f"{number:.3f}"
    return f"{number:,}" if isinstance(number, int) else str(number)
