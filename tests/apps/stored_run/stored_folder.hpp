#pragma once

#include <string>

#include "tests/apps/program/program.hpp"

namespace orbid::tests {

/// An output folder made by hand: two parameters of the Henon map, two cycles, four records.
inline void write_stored_run(const Path& folder, double a = 1.4, double sd = 0.01) {
    std::filesystem::create_directories(folder);
    json job = json::parse(R"({ "format": "orbid-job/1", "title": "made <by> hand",
        "model": { "name": "henon", "variant": "", "parameters": { "a": 1.4, "b": 0.3 } }, "seed": 1,
        "data": [ { "name": "run1", "simulate": { "sections": 1000, "trajectories": 1 } } ],
        "estimate": { "parameters": { "a": { "start": 1.3 }, "b": { "start": 0.2 } },
                      "residuals": [ { "type": "series", "data": ["run1"] } ] },
        "output": { "series": "none" } })");
    write_job(folder / "job.json", job);
    nlohmann::ordered_json result =
        nlohmann::ordered_json::parse(R"({ "format": "orbid-result/1", "status": "converged", "message": "",
        "parameters": {
          "b": { "value": 0.3, "sd": 0.02, "interval95": [0.26, 0.34], "start": 0.2, "reference": 0.3, "unit": "1" },
          "a": { "value": 0, "sd": 0, "interval95": [1.38, 1.42], "start": 1.3, "reference": 1.4, "unit": "1" } },
        "derived": {},
        "errors": { "series.x": { "sd": 0.001, "factor": null, "unit": "1", "count": 4 } },
        "correlation": { "names": ["b", "a"], "matrix": [[1, -0.5], [-0.5, 1]] },
        "identifiability": { "singular_values": [100, 1], "null_directions": [], "trust_normal": true },
        "objective": 10, "log_evidence": { "value": -12, "reason": null }, "degrees_of_freedom": 2,
        "history": [ { "round": 1, "block": "theta", "accepted": true, "before": 100, "after": 1 },
                     { "round": 1, "block": "theta", "accepted": false, "before": 1, "after": 2 } ] })");
    result["parameters"]["a"]["value"] = a;
    result["parameters"]["a"]["sd"] = sd;
    write_text(folder / "result.json", result.dump(2));
    // The fixed point, and the cycle of period 2 with other points than the map's: only drawn and matched here.
    write_job(folder / "cycles.json", json::parse(R"({ "format": "orbid-cycles/1", "model": "henon",
        "coordinates": ["x", "y"], "units": ["1", "1"], "cycles": [
          { "period": 1, "points": [[0.6313544770895048, 0.18940634312685144]], "multipliers": [[-1.92, 0], [0.16, 0]],
            "ln_multiplier_covariance": [[0.0001, 0], [0, 0.0001]] },
          { "period": 2, "points": [[0.9758, -0.1427], [-0.4758, 0.2927]], "multipliers": [[-3.01, 0], [-0.03, 0]] } ] })"));
    write_text(folder / "residuals.csv",
               "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd\n"
               "run1,\"a, b\",x,0,1.5,1.25,0.25\nrun1,\"a, b\",x,1,2,2.5,0.25\nrun1,\"a, b\",x,2,,2.5,0.25\n"
               "run1,\"a, b\",x,3,1,1,0.25\n");
}

}  // namespace orbid::tests
