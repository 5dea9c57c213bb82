#include "apps/campaign/tables/binomial_interval.hpp"

#include <stdexcept>

#include <boost/math/special_functions/beta.hpp>

namespace orbid::apps {

BinomialInterval binomial_interval(std::int64_t count, std::int64_t trials, double level) {
    if (count < 0 || count > trials || !(level > 0 && level < 1))
        throw std::invalid_argument("an interval needs 0 <= count <= trials and 0 < level < 1");
    const auto seen = static_cast<double>(count);
    const auto unseen = static_cast<double>(trials - count);
    const double tail = 0.5 * (1 - level);
    BinomialInterval out;
    if (count > 0) out.lower = boost::math::ibeta_inv(seen, unseen + 1, tail);
    if (count < trials) out.upper = boost::math::ibetac_inv(seen + 1, unseen, tail);
    return out;
}

}  // namespace orbid::apps
