#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace orbid::apps {

/// The first place where two JSON values differ, in the order of sorted keys, in words: "/seed is 1 there, 2 here".
/// Empty when they are equal.
/// @param here  what `wanted` is called: "in this job".
[[nodiscard]] std::string first_difference(const nlohmann::json& stored, const nlohmann::json& wanted,
                                           const std::string& here = "in this job");

}  // namespace orbid::apps
