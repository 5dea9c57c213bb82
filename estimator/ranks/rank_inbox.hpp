#pragma once

#include <algorithm>
#include <deque>
#include <optional>
#include <utility>

#include "estimator/ranks/ranks.hpp"

namespace orbid::estimator {

/// Messages that have arrived at a rank and wait to be received.
class RankInbox {
public:
    void put(RankMessage message) { messages_.push_back(std::move(message)); }
    /// The oldest message of a rank, or of any (Ranks::any).
    [[nodiscard]] std::optional<RankMessage> take(int from) {
        const auto found = std::find_if(messages_.begin(), messages_.end(), [from](const RankMessage& each) {
            return from == Ranks::any || each.from == from;
        });
        if (found == messages_.end()) return std::nullopt;
        RankMessage message = std::move(*found);
        messages_.erase(found);
        return message;
    }

private:
    std::deque<RankMessage> messages_;
};

}  // namespace orbid::estimator
