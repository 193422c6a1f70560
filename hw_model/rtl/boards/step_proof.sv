// Proof of update.sv: the step of a compartment is that of the formulas, computed in integers of 40 bits, which never overflow,
// for every state, charge, constant and joined voltage, and whatever surrounds the compartment in the pipeline. Memories may hold
// anything (any_memory.sv), so this proof does not say that compartments never read what others are about to write.
//
//     rz(x, d) = sign(x) * ((|x| * keep) >> 12) with keep = 4096 - d. The module multiplies the two halves of x alone, so the
//         proof puts them together: x * keep = 4096 * (x[23:12] * keep) + x[11:0] * keep
//     q = charge * 64, wrapped to 22 bits         (charges are in units of 64)
//     u = rz(u, d_u) + q, wrapped to 24 bits
//     v = rz(v, d_v) + (u + bias, wrapped to 24 bits) + joined, clipped to vmin..vmax
//     spike where v > 64 * threshold and the compartment is not blocked; then v = 0, and the compartment is blocked for `blocks`
//         steps: its v is held at 0, and each step takes 1 from the count
//
// The formulas only need what a compartment brings with it, so the proof copies that from the module, cycle by cycle, computes
// the formulas from the copies when the compartment is in its last cycle, and asserts that the module has the same results.
//
// Words of the module's memories, lowest bit first (update.sv):
//
//     state  [23:0] u, [47:24] v, [53:48] steps to stay blocked
//     leak   [0] 1 for a compartment, 0 for a gap, [13:1] keep of u, [26:14] keep of v, [46:27] bias, [47] has joined children
//     fire   [16:0] threshold, [22:17] blocks, [23] may spike, [28:24] log2 of 1 - vmin, [33:29] log2 of vmax + 1, then where a
//            compartment joins and what the readout does with it, which the formulas do not need
//
// (* hierconn *) is an attribute of Yosys: when its command `flatten` dissolves the module `dut`, it connects a wire with this
// attribute to the wire of the module that has this name. So the proof reads wires that are not ports.
//
// Outputs for the readout (early_read, read_out, ...) and `busy` are not asserted here: readout_proof.sv takes any values of
// them, and the simulations compare the answers that they lead to.
module step_proof (
    input logic         clk,
    input logic         issue,
    input logic         first_step,
    input logic [8:0]   number,
    input logic [17:0]  charge
);
    wire [8:0]         early_number;
    wire               done, fired, active, charge_wrap, voltage_clip, early_read, read_out, by_potential, busy;
    wire [8:0]         done_number;
    wire signed [23:0] done_u, done_v, potential;
    wire [1:0]         current_wraps;
    wire [6:0]         early_entry, entry;
    update #(.COMPARTMENTS(512), .CHARGE(18), .JOIN(26), .ENTRIES(128)) dut (
        .clk, .clear(1'b0), .load_leak(1'b0), .load_fire(1'b0), .load_address(24'b0), .load_data(128'b0),
        .issue, .first_step, .number, .origin(9'd0), .charge, .busy, .early_number, .done, .done_number, .fired, .done_u, .done_v, .potential, .active,
        .charge_wrap, .current_wraps, .voltage_clip, .early_read, .early_entry, .read_out, .by_potential, .entry
    );
    (* hierconn *) wire [53:0]        \dut.state1 ;
    (* hierconn *) wire [47:0]        \dut.leak1 ;
    (* hierconn *) wire [24:0]        \dut.leak_u.high ;
    (* hierconn *) wire [24:0]        \dut.leak_u.low ;
    (* hierconn *) wire [24:0]        \dut.leak_v.high ;
    (* hierconn *) wire [24:0]        \dut.leak_v.low ;
    (* hierconn *) wire [23:0]        \dut.left_u4 ;
    (* hierconn *) wire [23:0]        \dut.left_v4 ;
    (* hierconn *) wire signed [25:0] \dut.joined4 ;
    (* hierconn *) wire [53:0]        \dut.fire5 ;
    (* hierconn *) wire [53:0]        \dut.new_state8 ;
    (* hierconn *) wire               \dut.changed8 ;

    // What a compartment brings with it, from the cycle in which it arrives to the last one: bit or word n belongs to the
    // compartment in cycle n of the pipeline. lefts_u and lefts_v are what the leak left of u and v.
    logic [8:1]        issued = 0;
    logic [8:1][8:0]   numbers;
    logic [8:2]        firsts;
    logic [8:2][53:0]  stored;
    logic [8:2][47:0]  leaks;
    logic [8:3][17:0]  charges;
    logic [8:5][23:0]  lefts_u, lefts_v;
    logic [8:5][25:0]  joins;
    logic [8:6][53:0]  fires;
    logic              first1, first_before;  // one value: first1 is a word of the chain above, first_before is for an assumption
    logic [8:0]        early_before;  // early_number comes one cycle before the results
    logic [24:0]       high_u4, low_u4, high_v4, low_v4;  // products of the module in cycle 3, as cycle 4 uses them
    always_ff @(posedge clk) begin
        {first1, first_before} <= {2{first_step}};
        early_before <= early_number;
        issued <= {issued[7:1], issue};
        numbers <= {numbers[7:1], number};
        firsts <= {firsts[7:2], first1};
        stored <= {stored[7:2], \dut.state1 };
        leaks <= {leaks[7:2], \dut.leak1 };
        charges <= {charges[7:3], charge};
        {lefts_u, lefts_v} <= {lefts_u[7:5], \dut.left_u4 , lefts_v[7:5], \dut.left_v4 };
        {high_u4, low_u4, high_v4, low_v4} <= { \dut.leak_u.high , \dut.leak_u.low , \dut.leak_v.high , \dut.leak_v.low };
        joins <= {joins[7:5], leaks[4][47] ? \dut.joined4 : 26'b0};
        fires <= {fires[7:6], \dut.fire5 };
    end

    // x * keep / 4096 toward zero, from the products of its halves: the floor, and 1 more if it is negative with a fraction.
    function automatic signed [39:0] rz(input negative, input signed [24:0] high, input [24:0] low);
        logic signed [39:0] product;
        begin
            product = $signed({{3{high[24]}}, high, 12'b0}) + $signed({15'b0, low});
            rz = (product >>> 12) + $signed({39'b0, negative && product[11:0] != 0});
        end
    endfunction
    function automatic signed [39:0] wrapped(input signed [39:0] x);
        wrapped = {{16{x[23]}}, x[23:0]};
    endfunction

    // The formulas, for the compartment in the last cycle.
    wire                valid = issued[8] && leaks[8][0];  // a gap, which lets a parent wait for its children, has no results
    wire [5:0]          blocked;
    wire signed [23:0]  u, v;
    assign {blocked, v, u} = firsts[8] ? 54'b0 : stored[8];
    wire signed [23:0]  left_u = lefts_u[8], left_v = lefts_v[8];
    wire signed [19:0]  bias = leaks[8][46:27];
    wire [16:0]         threshold = fires[8][16:0];
    wire [5:0]          blocks = fires[8][22:17];
    wire                spiking = fires[8][23];  // 0: it only adds to its parent, or is clipped below its threshold
    wire [4:0]          vmin_log = fires[8][28:24], vmax_log = fires[8][33:29];
    wire signed [39:0]  charge64 = $signed({{16{charges[8][17]}}, charges[8], 6'b0});
    wire signed [39:0]  q = {{18{charge64[21]}}, charge64[21:0]};
    wire signed [39:0]  u_sum = left_u + q;
    wire signed [39:0]  u_new = wrapped(u_sum);
    wire signed [39:0]  drive = u_new + bias;
    wire signed [25:0]  joined = joins[8];
    wire signed [39:0]  v_sum = left_v + wrapped(drive) + joined;
    wire signed [39:0]  vmin = 40'sd1 - (40'sd1 <<< vmin_log), vmax = (40'sd1 <<< vmax_log) - 40'sd1;
    wire signed [39:0]  clipped = v_sum < vmin ? vmin : v_sum > vmax ? vmax : v_sum;
    wire                held = blocked != 0;
    wire signed [39:0]  open = held ? 40'sd0 : clipped;
    wire signed [39:0]  limit = $signed({17'b0, threshold, 6'b0});
    wire                spike = spiking && !held && clipped > limit;
    wire [5:0]          blocked_new = spike ? blocks : held ? blocked - 6'd1 : 6'd0;
    wire signed [39:0]  v_new = spike ? 40'sd0 : open;

    // For the leak, which is proved in two steps: first that the module's products are right (cycle 3), then, from these products,
    // that the quotient of their sum is (cycle 4).
    wire [23:0]         u3 = firsts[3] ? 24'b0 : stored[3][23:0], v3 = firsts[3] ? 24'b0 : stored[3][47:24];
    wire [23:0]         u4 = firsts[4] ? 24'b0 : stored[4][23:0], v4 = firsts[4] ? 24'b0 : stored[4][47:24];
    wire [12:0]         keep_u3 = leaks[3][13:1], keep_v3 = leaks[3][26:14];
    wire signed [39:0]  vmax5 = (40'sd1 <<< \dut.fire5 [33:29]) - 40'sd1;

    logic [3:0] age = 0;  // cycles since the beginning, up to 9, when a compartment has come through the pipeline
    always_ff @(posedge clk) if (age != 9) age <= age + 1;

    always_comb begin
        // The loader writes no other constants, and the sequencer begins a step when all of the last one is done.
        assume ( \dut.leak1 [13:1] <= 4096 && \dut.leak1 [26:14] <= 4096);
        assume ( \dut.fire5 [28:24] <= 23 && \dut.fire5 [33:29] <= 23);
        if ( \dut.fire5 [23]) assume (vmax5 > $signed({17'b0, \dut.fire5 [16:0], 6'b0}));
        if (issued != 0) assume (first_step == first_before);  // it does not change while compartments are in the pipeline
        if (age >= 3 && issued[3]) begin
            assert ( \dut.leak_u.low == {13'b0, u3[11:0]} * {12'b0, keep_u3} && \dut.leak_v.low == {13'b0, v3[11:0]} * {12'b0, keep_v3});
            assert ($signed( \dut.leak_u.high ) == $signed({{13{u3[23]}}, u3[23:12]}) * $signed({12'b0, keep_u3}));
            assert ($signed( \dut.leak_v.high ) == $signed({{13{v3[23]}}, v3[23:12]}) * $signed({12'b0, keep_v3}));
        end
        if (age >= 4 && issued[4]) begin
            assert ($signed( \dut.left_u4 ) == rz(u4[23], high_u4, low_u4));
            assert ($signed( \dut.left_v4 ) == rz(v4[23], high_v4, low_v4));
        end
        if (age == 9) begin
            assert (done == valid);
            if (valid) begin
                assert (done_number == numbers[8] && early_before == numbers[8]);
                assert (done_u == u_new);
                assert (done_v == v_new);
                assert (potential == open);
                assert (fired == spike);
                assert (charge_wrap == (charge64 != q));
                // The sum of two wraps. That of u always counts, that of u + bias only if v is not held: otherwise it is not used.
                assert (current_wraps == {1'b0, u_sum != u_new} + {1'b0, drive != wrapped(drive) && !held});
                assert (voltage_clip == (clipped != v_sum && !held));
                assert (active == (charges[8] != 0 || u != 0 || v != 0 || bias != 0 || joined != 0));
                assert (\dut.new_state8 == {blocked_new, v_new[23:0], u_new[23:0]});
                // What is not written back would have stayed as it was.
                if (! \dut.changed8 ) assert (\dut.new_state8 == stored[8]);
            end
        end
    end
endmodule
