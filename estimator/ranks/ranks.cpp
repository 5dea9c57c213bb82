#include "estimator/ranks/ranks.hpp"

#include <utility>

namespace orbid::estimator {

RankMessage Ranks::receive(int from) {
    for (;;)
        if (std::optional<RankMessage> message = receive(from, std::chrono::minutes(1))) return std::move(*message);
}

}  // namespace orbid::estimator
